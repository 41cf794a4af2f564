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

"""How a bag's folder tells its state: names of files, mark of a recording, lock."""

import fcntl
import json
import os
from collections.abc import Mapping
from pathlib import Path

from ppc_attitude.bags.errors import BagError
from ppc_attitude.contract.whole_file import write_whole

METADATA = "metadata.yaml"
UNFINISHED = "unfinished.json"  # custom data of a bag that is being recorded, or was cut


def write_unfinished(folder: Path, custom_data: Mapping[str, str]) -> None:
    """Mark the bag in a folder as unfinished and keep its custom data, in one atomic step."""
    write_whole(folder / UNFINISHED, json.dumps({"custom_data": dict(custom_data)}))


def claimed(folder: Path) -> bool:
    """Whether a living process holds a bag's folder."""
    try:
        os.close(_locked(folder, fcntl.LOCK_SH))
    except OSError as error:  # or no folder, or a file system without locks
        return isinstance(error, BlockingIOError)
    return False


def claim(folder: Path) -> int:
    """Lock a bag's folder until the descriptor is closed or the process is gone.

    Raises
    ------
    BagError
        Another living process holds it.
    """
    try:
        return _locked(folder, fcntl.LOCK_EX)
    except BlockingIOError as error:
        raise BagError(f"{folder} is still being recorded") from error


def _locked(folder: Path, kind: int) -> int:
    """Descriptor of a folder with a lock; BlockingIOError if another one is in its way."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor
