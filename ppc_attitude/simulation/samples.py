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

"""The samples of a run as the loop writes them: a row for each component, a column an instant.

So the instants of a component lie side by side, and who reads one topic need not pass the others.
"""

from collections import namedtuple
from itertools import accumulate
from typing import Any

import numpy as np

from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import SAMPLED
from ppc_attitude.science.kernel import Quaternion, Vector, kernel

_STARTS = [0, *accumulate(topic.width for topic in SAMPLED)]
_named_tuple: Any = namedtuple  # a checker wants the names of its fields written out
_Rows = _named_tuple("_Rows", [topic.column for topic in SAMPLED])
ROWS: Any = _Rows(*_STARTS[:-1])
"""First row of each column (`contract.topics`), by its name."""


def new_samples(size: int) -> Array:
    """Room for the samples of `size` instants."""
    return np.zeros((_STARTS[-1], size))


def columns_of(samples: Array) -> dict[str, Array]:
    """Return a view of each column, of shape (n, width), by its name."""
    return {
        topic.column: samples[start : start + topic.width].T
        for topic, start in zip(SAMPLED, ROWS, strict=True)
    }


@kernel
def put(samples: Array, row: int, k: int, a: Vector) -> None:
    """Write a vector as the sample of instant k."""
    samples[row, k] = a[0]
    samples[row + 1, k] = a[1]
    samples[row + 2, k] = a[2]


@kernel
def put_quaternion(samples: Array, row: int, k: int, a: Quaternion) -> None:
    """Write a quaternion as the sample of instant k."""
    samples[row, k] = a[0]
    samples[row + 1, k] = a[1]
    samples[row + 2, k] = a[2]
    samples[row + 3, k] = a[3]


@kernel
def taken(samples: Array, row: int, k: int) -> Vector:
    """Vector of instant k."""
    return (samples[row, k], samples[row + 1, k], samples[row + 2, k])


@kernel
def taken_quaternion(samples: Array, row: int, k: int) -> Quaternion:
    """Quaternion of instant k."""
    return (samples[row, k], samples[row + 1, k], samples[row + 2, k], samples[row + 3, k])
