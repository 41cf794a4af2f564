# Copyright 2026 the ppc_attitude authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The error that every layer raises for a value that the user can correct."""

from collections.abc import Iterator
from contextlib import contextmanager

_LONGEST = 4000  # characters


class ConfigurationError(ValueError):
    """A parameter is wrong; the message names it, its value and what is allowed.

    The middle of a long message is left out, as a value may be a list of a million numbers.
    """

    def __init__(self, text: str) -> None:
        if len(text) > _LONGEST:
            text = f"{text[: _LONGEST // 2]} … {text[-_LONGEST // 2 :]}"
        super().__init__(text)


@contextmanager
def needed_by(what: str, extra: str) -> Iterator[None]:
    """Context in which to import packages that only an optional extra of ours installs.

    Raises
    ------
    ConfigurationError
        One is not installed, or does not go with another; the message says what needs it, and how
        to install it.
    """
    try:
        yield
    except ImportError as error:
        told = f"{what}: pip install 'ppc_attitude[{extra}]' ({error})"
        raise ConfigurationError(told) from None
