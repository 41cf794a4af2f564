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

"""Check where a command will write before it begins its work."""

import argparse
import os
from pathlib import Path

from ppc_attitude.science.errors import ConfigurationError


def new_folder(text: str) -> Path:
    """Parse where files are to be; the folder and those above it are made."""
    path = _writable(text)
    if path.exists() and not path.is_dir():
        raise argparse.ArgumentTypeError(f"{text} is no folder")
    return path


def new_file(text: str) -> Path:
    """Parse where a file is to be; the folders above it are made."""
    path = _writable(text)
    if os.path.lexists(path) and (path.is_symlink() or not path.is_file()):
        what = "a folder" if path.is_dir() else "no plain file"
        raise argparse.ArgumentTypeError(f"{text} is {what}")  # which the new one would replace
    return path


def new_bag(path: Path) -> Path:
    """See that a bag can be made there.

    Raises
    ------
    ConfigurationError
        The folder exists.
    """
    if path.exists():
        raise ConfigurationError(f"bag folder {path} exists already and is not overwritten")
    return path


def absent_file(text: str) -> Path:
    """Parse where a file is to be that is not there yet; the folders above it are made."""
    path = _writable(text)
    if os.path.lexists(path):
        raise argparse.ArgumentTypeError(f"{text} exists already, it is not overwritten")
    return path


def new_table(text: str) -> Path:
    """Parse the path of a new table; its suffix says the format, and no such file may exist yet."""
    path = absent_file(text)
    if path.suffix not in (".csv", ".parquet"):
        raise argparse.ArgumentTypeError(f"{text}: allowed are files that end in .csv or .parquet")
    return path


def _writable(text: str) -> Path:
    if not text:
        raise argparse.ArgumentTypeError("the path is empty")
    path = Path(text)
    home = next(each for each in path.absolute().parents if each.exists())
    if not home.is_dir():
        raise argparse.ArgumentTypeError(f"{text}: {home} is no folder")
    if not os.access(home, os.W_OK | os.X_OK):
        raise argparse.ArgumentTypeError(f"{text}: nothing can be written into {home}")
    return path
