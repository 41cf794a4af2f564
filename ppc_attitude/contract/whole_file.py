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

"""Files that appear at their place only when they are complete, and names of new folders."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from itertools import count
from pathlib import Path
from typing import BinaryIO


def unfinished_of(path: Path, others: int = 0) -> Path:
    """Place of a file that is still growing; `others` counts the places that are taken."""
    return path.with_name(f"{path.name}{f'.{others}' if others else ''}.unfinished")


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Give an OSError the name of its file, which it lacks if the disk is full."""
    try:
        yield
    except OSError as error:
        error.filename = error.filename or str(path)
        raise


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """File to write, beside its place while it grows, in a folder that is made if there is none.

    No step follows a link or deletes another's file, such as that of a process that writes the same
    one.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    for others in count():  # up to the first place that is free
        unfinished = unfinished_of(path, others)
        with suppress(FileExistsError):
            opened = unfinished.open("xb")
            break
    try:
        with naming(path), opened as file:
            yield file
        unfinished.replace(path)
    except BaseException:
        unfinished.unlink(missing_ok=True)
        raise


def dated(folder: str) -> Path:
    """Place of a new folder in another one, named by the time and this process."""
    return Path(folder, f"{datetime.now():%Y-%m-%d_%H-%M-%S}_{os.getpid()}")


def write_whole(path: Path, text: str) -> None:
    """Write a text as `whole_file` does."""
    with whole_file(path) as file:
        file.write(text.encode())
