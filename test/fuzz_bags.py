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

"""Readers and configuration under random bytes; the first chooses what the others are, and where.

``NUMBA_DISABLE_JIT=1 python test/fuzz_bags.py FOLDER`` lets a coverage-guided fuzzer (atheris, from
PyPI) look for inputs that end in anything but a result or a clear error. It adds what it finds to
the folder; `test_fuzz.py` replays those that were worth keeping.
"""

import contextlib
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

try:
    import atheris
except ImportError:  # only replayed
    searched = contextlib.nullcontext()
else:
    searched = atheris.instrument_imports(include=["ppc_attitude"])

with searched:
    import numpy as np
    from bag_helpers import unfinished
    from synthetic import normal_run

    from ppc_attitude.analysis.requirements import load_requirements
    from ppc_attitude.bags.errors import BagError
    from ppc_attitude.bags.reader import read_runs
    from ppc_attitude.bags.recover import recover
    from ppc_attitude.bags.run_writer import write_run
    from ppc_attitude.campaign.declaration import load_campaign
    from ppc_attitude.command_line.guarantee_view import certificate_path, stored_certificate
    from ppc_attitude.science.errors import ConfigurationError
    from ppc_attitude.simulation.scenario import load, scenario

# What the bytes are put in place of, in a bag of this storage; a capital asks to recover it.
PLACES = {
    b"m": ("mcap", "bag.mcap"),
    b"z": ("mcap", "bag.mcap.zstd"),
    b"s": ("sqlite3", "bag.db3"),
    b"j": ("sqlite3", "bag.db3-journal"),
    b"w": ("sqlite3", "bag.db3-wal"),
    b"y": ("mcap", "metadata.yaml"),
    b"u": ("mcap", "unfinished.json"),
}
FILES: dict[bytes, Callable[[Path], object]] = {
    b"c": lambda file: load([file]),
    b"r": lambda file: load_requirements([file]),
    b"d": lambda file: load_campaign(file, scenario({}), seed=0),
    b"k": lambda file: stored_certificate([file.replace(certificate_path(file))]),
}


def attempt(data: bytes) -> None:
    """Read what the bytes are; raises what no user may see."""
    with TemporaryDirectory() as folder:
        if data[:1] in FILES:
            file = Path(folder) / "configuration.yaml"
            file.write_bytes(data[1:])
            with contextlib.suppress(ConfigurationError):
                FILES[data[:1]](file)
        elif data[:1].lower() in PLACES:
            bag = Path(folder) / "bag"
            _put(bag, *PLACES[data[:1].lower()], data[1:])
            if data[:1].isupper():
                with contextlib.suppress(BagError):
                    recover(bag)
            _read(bag)


def _put(bag: Path, storage: str, name: str, content: bytes) -> None:
    bag.mkdir()
    for name_of_other, other in _whole(storage, finished=name == "metadata.yaml").items():
        (bag / name_of_other).write_bytes(other)
    if name.endswith(".zstd"):
        (bag / "bag.mcap").unlink()
    (bag / name).write_bytes(content)


def _read(bag: Path) -> None:
    with contextlib.suppress(BagError):
        for run in read_runs(bag):
            assert (np.diff(run.stamps_ns) > 0).all()
            assert all(text.isprintable() for text in (run.controller, *run.warnings))


_BAGS: dict[tuple[str, bool], dict[str, bytes]] = {}


def _whole(storage: str, *, finished: bool) -> dict[str, bytes]:
    """Files of a short bag."""
    if (storage, finished) not in _BAGS:
        with TemporaryDirectory() as folder:
            bag = Path(folder) / "bag"
            run = normal_run(duration=0.02)
            if finished:
                write_run(run, bag, storage=storage)
            else:
                unfinished(bag, storage, run)
            _BAGS[storage, finished] = {
                file.name.replace("live", "bag"): file.read_bytes() for file in bag.iterdir()
            }
    return _BAGS[storage, finished]


if __name__ == "__main__":
    atheris.Setup(sys.argv, attempt)
    atheris.Fuzz()
