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

"""The errors of bags, and how their words are told."""

from typing import Any

_LONGEST_QUOTE = 300  # characters


class BagError(ValueError):
    """A bag cannot be written, read, recovered or exported; the message says why."""

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


def shortened(what: object) -> str:
    """Text of a stranger, or of an error that may repeat one, as our own sentences quote it."""
    text = str(what)
    return text if len(text) <= _LONGEST_QUOTE else f"{text[:_LONGEST_QUOTE]}…"


def printable(text: str) -> str:
    """Text of a stranger with escapes for all that would steer a terminal or a page."""
    if text.isprintable():
        return text
    return "".join(
        each if each.isprintable() else each.encode("unicode_escape").decode()
        for each in " ".join(text.split())
    )


def all_printable(value: Any) -> Any:
    """Content of a JSON text with every key and text in it printable."""
    if isinstance(value, dict):
        return {all_printable(key): all_printable(each) for key, each in value.items()}
    if isinstance(value, list):
        return [all_printable(each) for each in value]
    return printable(value) if isinstance(value, str) else value
