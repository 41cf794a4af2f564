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

"""The tables of `truth`: columns by name, numbers, and the notes that begin with #."""

import gzip
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

TRUTH = Path(__file__).parent / "truth"
Array = NDArray[np.float64]


def _lines(name: str) -> list[str]:
    with gzip.open(TRUTH / f"{name}.csv.gz", "rt") as file:
        return file.read().splitlines()


def notes(name: str) -> list[str]:
    return [line for line in _lines(name) if line.startswith("#")]


def rows(name: str) -> tuple[list[str], Any]:
    """Column names and the rows, as text, of a table."""
    lines = [line.split(",") for line in _lines(name) if not line.startswith("#")]
    return lines[0], np.array(lines[1:])


def numbers(name: str) -> Array:
    return np.asarray(rows(name)[1], np.float64)


def table(name: str) -> dict[str, Array]:
    """Columns of a table of numbers by their names."""
    return dict(zip(rows(name)[0], numbers(name).T, strict=True))


def columns(data: dict[str, Array], *names: str) -> Array:
    """Several columns of a table side by side."""
    return np.stack([data[name] for name in names], axis=-1)
