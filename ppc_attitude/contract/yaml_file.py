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

"""YAML of somebody else's: the whole of it, or one error that says what is wrong with it."""

from pathlib import Path
from typing import Any

import yaml

from ppc_attitude.science.errors import ConfigurationError

FAST: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
# What PyYAML's constructors raise besides its own errors, for values such as `2020-13-01`.
_ITS_ERRORS = (yaml.YAMLError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError)


def parsed(text: str, loader: Any = yaml.SafeLoader) -> Any:
    """Content of a text.

    Raises
    ------
    ValueError
        The text is not YAML.
    """
    try:
        return yaml.load(text, loader)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    except _ITS_ERRORS as error:
        raise ValueError(str(error)) from None


def read(path: Path, kind: str, loader: Any = yaml.SafeLoader) -> Any:
    """Content of a file.

    Parameters
    ----------
    path : Path
        The file.
    kind : str
        What it is to the user, for the message.
    loader : yaml.SafeLoader or derived, optional
        How scalars are read.

    Raises
    ------
    ConfigurationError
        It cannot be read, or is not YAML.
    """
    try:
        return parsed(path.read_text(encoding="utf-8"), loader)
    except OSError as error:
        raise ConfigurationError(f"{kind} {path}: {error.strerror}") from None
    except ValueError as error:
        raise ConfigurationError(f"{kind} {path} is not YAML: {error}") from None
