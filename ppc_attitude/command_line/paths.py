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

"""Where a command will write, checked before it begins its work, and where config/ is."""

import argparse
import os
from collections.abc import Callable, Collection
from pathlib import Path

from ppc_attitude.science.errors import ConfigurationError

_BEGINNING = 512  # bytes, of which the mark of a file that a command wrote is a part


def new_folder(text: str) -> Path:
    """Parse a folder for files; it and those above it need not exist yet."""
    path = some_path(text)
    if path.exists() and not path.is_dir():
        raise argparse.ArgumentTypeError(f"{text} is no folder")
    _see_that_it_is_writable(text, path)
    return path


def new_bag(text: str) -> Path:
    """Parse the folder of a new bag."""
    path = new_folder(text)
    if path.exists():
        raise argparse.ArgumentTypeError(f"{text} exists already and is not overwritten")
    return path


def new_file(*suffixes: str, replaces: Collection[str] = ()) -> Callable[[str], Path]:
    """Give a parser of the path of a new file; the folders above it need not exist yet.

    Parameters
    ----------
    suffixes : str
        What its name may end in; without any, in anything. Two outputs of a command end in
        different ones, so that they are never the same file.
    replaces : collection of str, optional
        Marks, of which one stands at the beginning of a file that may be replaced; by default none
        may.
    """

    def parsed(text: str) -> Path:
        path = some_path(text)
        _see_that_it_is_writable(text, path.absolute().parent)
        if os.path.lexists(path):
            if path.is_symlink() or not path.is_file():
                what = "a folder" if path.is_dir() else "no plain file"
                raise argparse.ArgumentTypeError(f"{text} is {what}")  # it would be replaced
            if not replaces:
                raise argparse.ArgumentTypeError(f"{text} exists already, it is not overwritten")
            see_that_it_may_go(path, *replaces)
        if suffixes and path.suffix not in suffixes:
            allowed = " or ".join(suffixes)
            raise argparse.ArgumentTypeError(f"{text}: allowed are files that end in {allowed}")
        return path

    return parsed


def see_that_it_may_go(path: Path, *marks: str) -> None:
    """See that a file, if it is there, is empty or has a mark of its kind at its beginning.

    Raises
    ------
    argparse.ArgumentTypeError
        It has no such mark, and may be of somebody else.
    """
    if not path.exists():
        return
    with path.open("rb") as file:
        beginning = file.read(_BEGINNING)
    if beginning and not any(mark.encode() in beginning for mark in marks):
        raise argparse.ArgumentTypeError(
            f"{path} exists already and does not say that this command wrote it: it is not "
            "overwritten"
        )


def some_path(text: str) -> Path:
    """Parse a path; an empty text, which would mean the current folder, is refused."""
    if not text:
        raise argparse.ArgumentTypeError("the path is empty")
    return Path(text)


def _see_that_it_is_writable(text: str, folder: Path) -> None:
    """See that files can be written into a folder, or that it can be made."""
    folder = folder.absolute()
    home = next(each for each in (folder, *folder.parents) if os.path.lexists(each))
    if not home.is_dir():
        raise argparse.ArgumentTypeError(f"{text}: {home} is no folder")
    if not os.access(home, os.W_OK | os.X_OK):
        raise argparse.ArgumentTypeError(f"{text}: nothing can be written into {home}")


def shipped_config(name: str, package: Path | None = None) -> Path:
    """Find a file of config/, beside the sources or in the share folder of an installation.

    The folder of this package is by default where it was imported from.

    Raises
    ------
    ConfigurationError
        This installation has no such file.
    """
    home = (package or Path(__file__).parents[1]).resolve()
    # pip and colcon put the package below PREFIX/lib, and what it shares below PREFIX/share.
    shared = (prefix / "share" / home.name / "config" for prefix in home.parents)
    for folder in (home.parent / "config", *shared):
        if (folder / name).is_file():
            return folder / name
    raise ConfigurationError(f"config/{name} is not installed with {home}: give a file instead")
