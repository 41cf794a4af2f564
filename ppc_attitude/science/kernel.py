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

"""How this project compiles: the decorator, and three-vectors as plain tuples.

Inside a kernel a vector is a tuple of floats. Tuples live in registers, so a controller step
allocates nothing, and they are values, so no function changes its caller's vector.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias, TypeVar, cast

import numba
import numpy as np
from numba.core import config as _numba_config

Vector: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]  # x y z w
Matrix: TypeAlias = tuple[Vector, Vector, Vector]  # rows

_Function = TypeVar("_Function", bound=Callable[..., Any])


_SETTINGS: Any = _numba_config  # its names are made at run time


def _cache_folder() -> Path:
    """Where compiled kernels are kept: one folder for each state of the sources.

    Numba looks for a change only in the file of the kernel itself. Kernels call functions and hold
    constants of other files, so after an edit, or an update of some files, it would run old
    machine code.
    """
    package = Path(__file__).parent.parent
    digest = hashlib.sha256()
    for folder in ("science", "contract", "simulation"):
        for source in sorted((package / folder).rglob("*.py")):
            digest.update(source.read_bytes())
    root = Path(_SETTINGS.CACHE_DIR or Path(__file__).parent / "__pycache__")
    return root / f"ppc_attitude-{digest.hexdigest()[:16]}"


# Where this folder cannot be written, Numba falls back to the user's own.
_SETTINGS.CACHE_DIR = str(_cache_folder())

# No fastmath: the node, the in-process loop and the replay must agree to the last bit.
OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}


def kernel(function: _Function) -> _Function:
    """Compile a function at its first call and cache the machine code."""
    return cast(_Function, numba.njit(**OPTIONS)(function))


def one(record: Any) -> Any:
    """Array of one record, for a kernel that Python calls often.

    To look at a record costs Numba 2 µs a call, to look at an array 0.2.
    """
    return np.array([record], record.dtype)


@kernel
def vector(a: Any) -> Vector:
    """Tuple of the first three numbers of an array."""
    return (a[0], a[1], a[2])


@kernel
def quaternion(a: Any) -> Quaternion:
    """Tuple of the four numbers of an array."""
    return (a[0], a[1], a[2], a[3])


@kernel
def matrix(a: Any) -> Matrix:
    """Rows of a 3 × 3 array as tuples."""
    return (
        (a[0, 0], a[0, 1], a[0, 2]),
        (a[1, 0], a[1, 1], a[1, 2]),
        (a[2, 0], a[2, 1], a[2, 2]),
    )


@kernel
def store(target: Any, a: Vector) -> None:
    """Write a vector into an array."""
    target[0] = a[0]
    target[1] = a[1]
    target[2] = a[2]


@kernel
def store_quaternion(target: Any, a: Quaternion) -> None:
    """Write a quaternion into an array."""
    target[0] = a[0]
    target[1] = a[1]
    target[2] = a[2]
    target[3] = a[3]


@kernel
def add(a: Vector, b: Vector) -> Vector:
    """A + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@kernel
def subtract(a: Vector, b: Vector) -> Vector:
    """A − b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@kernel
def scale(s: float, a: Vector) -> Vector:
    """S a."""
    return (s * a[0], s * a[1], s * a[2])


@kernel
def multiply(a: Vector, b: Vector) -> Vector:
    """diag(a) b."""
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2])


@kernel
def divide(a: Vector, b: Vector) -> Vector:
    """diag(1/b) a."""
    return (a[0] / b[0], a[1] / b[1], a[2] / b[2])


@kernel
def dot(a: Vector, b: Vector) -> float:
    """aᵀb."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a: Vector, b: Vector) -> Vector:
    """a^× b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@kernel
def norm(a: Vector) -> float:
    """‖a‖."""
    return float((a[0] * a[0] + a[1] * a[1] + a[2] * a[2]) ** 0.5)


@kernel
def largest(a: Vector) -> float:
    """Largest magnitude of a component of a."""
    return max(abs(a[0]), abs(a[1]), abs(a[2]))


@kernel
def apply(m: Matrix, a: Vector) -> Vector:
    """M a."""
    return (dot(m[0], a), dot(m[1], a), dot(m[2], a))


@kernel
def clamp(a: Vector, limit: float) -> Vector:
    """Every component of a limited to ±limit: sat(a)."""
    return (
        min(max(a[0], -limit), limit),
        min(max(a[1], -limit), limit),
        min(max(a[2], -limit), limit),
    )
