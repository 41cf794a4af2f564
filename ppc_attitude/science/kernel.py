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
import math
import os
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias, TypeVar, cast

import numba
from numba import types
from numba.core import caching, cgutils
from numba.core.runtime.nrt import rtsys
from numba.extending import intrinsic

from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.referred import digest_of, sources_of

Vector: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]  # x y z w
Matrix: TypeAlias = tuple[Vector, Vector, Vector]  # rows
ZERO: Vector = (0.0, 0.0, 0.0)
STRAIGHT: Quaternion = (0.0, 0.0, 0.0, 1.0)  # no turn at all
NO_ATTITUDE: Quaternion = (0.0, 0.0, 0.0, 0.0)  # stands for an unknown attitude

_Function = TypeVar("_Function", bound=Callable[..., Any])
ir: Any = vars(cgutils)["ir"]  # the builder of machine code that Numba uses
carray: Any = vars(numba)["carray"]  # Numba does not list it among its exports
_PACKAGE = __name__.partition(".")[0]

# No fastmath: the node, the in-process loop and the replay must agree to the last bit.
OPTIONS: dict[str, Any] = {"error_model": "numpy"}
# Nobody calls a kernel from C: that wrapper would take a fifth of the compiler's time.
_OF_KERNELS: dict[str, Any] = {**OPTIONS, "nogil": True, "no_cfunc_wrapper": True}


def _cache_folder(package: str) -> str:
    """Where compiled kernels of a package are kept: one folder for each state of the sources."""
    # Numba's own setting is not used: a file in the working directory may give it, whoever wrote
    # that file, and what is loaded from a cache is executed.
    root = Path(os.environ.get("NUMBA_CACHE_DIR") or Path(__file__).parent / "__pycache__")
    return str(root / f"ppc_attitude-{sources_of(package)}")


class CacheFile(caching.IndexDataCacheFile):
    """Entries of one function in the cache, each in a file that is named after its key.

    Numba numbers the files by the index that it read last. If two processes save at once, both may
    use one number, and from then on the index leads from one step to the machine code of another.
    With names made from keys the index can at worst lose an entry, which is then compiled again. A
    damaged file is compiled again, too: the machine may have stopped while it was written.
    """

    def load(self: Any, key: Any) -> Any:
        """Return the machine code of a key; None if there is none, or it is damaged."""
        whole: Any = super()
        with suppress(Exception):  # unpickling a damaged file may raise any exception
            return whole.load(key)

    def _load_index(self: Any) -> Any:
        whole: Any = super()
        with suppress(Exception):
            return whole._load_index()
        return {}

    def save(self: Any, key: Any, data: Any) -> None:
        """Save the machine code of a key.

        Raises
        ------
        ConfigurationError
            The folder is full, or cannot be written any more.
        """
        digest = hashlib.sha256(self._dump(key)).digest()
        name = self._data_name(int.from_bytes(digest[:8], "big"))
        try:
            self._save_data(name, data)
            self._save_index({**self._load_index(), key: name})
        except OSError as error:
            raise ConfigurationError(
                f"compiled kernels cannot be saved in {self._cache_path}: {error.strerror}; "
                "set NUMBA_CACHE_DIR to a folder that can be written and has room"
            ) from error


class _Place(caching._SourceFileBackedLocatorMixin, caching._CacheLocator):
    """The place of a function's machine code in a folder, which a subclass names."""

    def __init__(self: Any, function: Any, file: str) -> None:
        self._py_file, self._lineno = file, function.__code__.co_firstlineno
        self._path = str(Path(self.folder, self.get_suitable_cache_subpath(file)))

    def get_cache_path(self: Any) -> Any:
        """Return that place."""
        return self._path


class _Kept(caching.CompileResultCacheImpl):
    """Machine code in a folder; where that cannot be written, in a folder of the user's."""

    def __init__(self: Any, folder: str, function: Any) -> None:
        place, whole = type("Place", (_Place,), {"folder": folder}), cast(Any, super())
        self._locator_classes = [place, *self._locator_classes[1:]]  # the first is Numba's setting
        whole.__init__(function)


class Cache(caching.FunctionCache):
    """The cache of a compiled function, in the cache folder of a module's package.

    No setting of Numba's is changed, so functions of other packages are cached where they belong.
    The folder of the user's is one for all states of the sources, so their digest is part of each
    key.

    Before it reads a cache, Numba imports its whole compiler, two hundred modules, which took a
    third of the start of a command. Machine code of this package needs only Numba's runtime; code
    of other packages may need an extension of Numba.

    Raises
    ------
    ConfigurationError
        Numba finds no folder that it can write to.
    """

    def __init__(self: Any, function: Any, module: str) -> None:
        package = module.partition(".")[0]
        folder = _cache_folder(package)
        self._impl_class, whole = partial(_Kept, folder), cast(Any, super())
        try:
            whole.__init__(function)
        except RuntimeError as error:
            if not str(error).startswith("cannot cache function"):
                raise
            raise ConfigurationError(
                f"compiled kernels cannot be saved: neither {folder} nor a folder of the user's "
                "own can be written; set NUMBA_CACHE_DIR to one that can"
            ) from None
        named, stamp = self._impl.filename_base, self._impl.locator.get_source_stamp()
        self._cache_file = cast(Any, CacheFile)(self._cache_path, named, stamp)
        self._is_ours, self._told = package == _PACKAGE, sources_of(package)
        if not self._is_ours:  # it may refer to other packages than its own and ours
            self._told += digest_of(function)

    def load_overload(self: Any, signature: Any, target: Any) -> Any:
        """Return the machine code for a signature; None if there is none."""
        if not self._is_ours:
            return cast(Any, super()).load_overload(signature, target)
        rtsys.initialize(target)
        return self._load_overload(signature, target)

    def _index_key(self: Any, *asked: Any) -> Any:
        return (*cast(Any, super())._index_key(*asked), self._told)


class _Unopened(caching.NullCache):
    """Stand-in for a kernel's cache until its first call: opening all took a tenth of a start."""

    def __init__(self, compiled: Any) -> None:
        self._compiled = compiled

    def load_overload(self, *asked: Any) -> Any:
        """Open the cache, and look there."""
        self._compiled._cache = Cache(self._compiled.py_func, self._compiled.__module__)
        return self._compiled._cache.load_overload(*asked)


def kernel(function: _Function) -> _Function:
    """Compile a function at its first call and cache the machine code."""
    return _compiled(function, inline=False)


def inlined(function: _Function) -> _Function:
    """Compile a kernel into each that calls it.

    For a function that takes or returns many numbers at every step: a call would write them to
    memory, and reading them at once would have to wait for that.
    """
    return _compiled(function, inline=True)


def _compiled(function: _Function, inline: bool) -> _Function:
    # The columns of a record lie side by side. A kernel of another package that writes beyond one
    # would change the next, or other memory, and nobody would notice. So its bounds are checked.
    package = function.__module__.partition(".")[0]
    options = {**_OF_KERNELS, "forceinline": inline, "boundscheck": package != _PACKAGE}
    compiled: Any = numba.njit(**options)(function)
    compiled._cache = _Unopened(compiled)
    sources_of(package)  # takes the digest now: the files may change before the first call
    return cast(_Function, compiled)


def _called(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    record = ir.IntType(8).as_pointer()
    function = ir.FunctionType(ir.VoidType(), [record] * (len(arguments) - 1))
    address, *records = arguments
    builder.call(
        builder.inttoptr(address, function.as_pointer()),
        [builder.inttoptr(each, record) for each in records],
    )
    return context.get_dummy_value()


def _pointed(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.inttoptr(arguments[0], ir.IntType(8).as_pointer())


def _read_as(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.bitcast(arguments[0], context.get_value_type(signature.return_type))


def _call_step(context: Any, step: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    return types.void(*[types.uint64] * 5), _called


def _pointer(context: Any, address: Any) -> Any:
    return types.voidptr(types.uint64), _pointed


def _pointer_of(context: Any, record: Any) -> Any:
    return types.voidptr(record), _read_as


call_step: Any = intrinsic(_call_step)
"""Call the step at an address with the addresses of its four records."""
pointer_to: Any = intrinsic(_pointer_of)
"""Pointer to a record."""
_point: Any = intrinsic(_pointer)


@kernel
def array_at(address: int, count: int, dtype: Any) -> Any:
    """View of `count` elements of `dtype` at an address, which a configuration record holds."""
    return carray(_point(address), count, dtype)


@kernel
def vector(a: Any) -> Vector:
    """Tuple of the first three numbers of an array, or of a quaternion."""
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
def copy(target: Any, source: Any) -> None:
    """Write one row of numbers into another of its length.

    For `target[:] = source` Numba would also compile the error message for unequal lengths.
    """
    for k in range(len(target)):
        target[k] = source[k]


@kernel
def add(a: Vector, b: Vector) -> Vector:
    """Sum a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@kernel
def subtract(a: Vector, b: Vector) -> Vector:
    """Difference a − b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@kernel
def scale(s: float, a: Vector) -> Vector:
    """Multiple s a."""
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
def magnitudes(a: Vector) -> Vector:
    """|a_i| of every component."""
    return (abs(a[0]), abs(a[1]), abs(a[2]))


@kernel
def tanh(a: Vector) -> Vector:
    """tanh(a_i) of every component."""
    return (math.tanh(a[0]), math.tanh(a[1]), math.tanh(a[2]))


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
def bounded(a: Vector, limit: Vector) -> Vector:
    """Every component of a limited to its ±limit."""
    return (
        min(max(a[0], -limit[0]), limit[0]),
        min(max(a[1], -limit[1]), limit[1]),
        min(max(a[2], -limit[2]), limit[2]),
    )


@kernel
def clamp(a: Vector, limit: float) -> Vector:
    """Every component of a limited to ±limit: sat(a)."""
    return bounded(a, (limit, limit, limit))
