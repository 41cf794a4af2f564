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

"""Digests of what a compiled function was made of: its code, and all that the code refers to.

Numba compiles the value of a global name as a constant, and a kernel that is called as part of its
caller. But when it looks for a change, it looks at the file of the function alone.
"""

import hashlib
import sys
from collections.abc import Iterator
from contextlib import suppress
from enum import Enum, EnumMeta
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba import types

_OURS = __name__.partition(".")[0]
_ROOT = Path(__file__).parent.parent
_PLAIN = (bool, int, float, complex, str, bytes, np.dtype, types.Type, type(None))


@cache
def sources_of(package: str) -> str:
    """Digest of the sources that the kernels of a package may be made of.

    Numba looks for a change only in the file of the kernel itself. Kernels call functions and hold
    constants of other files, so after an edit, or an update of some files, it would run old
    machine code. Of another package all files count, also if it is a namespace package without a
    file of its own; of a module that is in no package, the files beside it count.
    """
    sources = [
        source
        for folder in ("science", "contract", "simulation")
        for source in sorted((_ROOT / folder).rglob("*.py"))
    ]
    module = sys.modules.get(package)
    if package != _OURS:
        folders, file = getattr(module, "__path__", ()), getattr(module, "__file__", None)
        sources += [source for each in folders for source in sorted(Path(each).rglob("*.py"))]
        if file and not folders:
            sources += sorted(Path(file).parent.glob("*.py"))
    digest = hashlib.sha256()
    for source in sources:
        with suppress(OSError):  # not everything beside a module is for this user to read
            digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def digest_of(function: Any) -> str:
    """Digest of a function or kernel that is the same in all processes, until something changes.

    Functions of this package that it calls are left out: `sources_of` covers them.
    """
    digest = hashlib.sha256()
    for piece in _pieces(function, set()):
        digest.update(piece)
    return digest.hexdigest()[:16]


def _pieces(value: Any, seen: set[int]) -> Iterator[bytes]:
    if isinstance(value, np.ndarray | np.generic):
        yield f"{value.dtype}{value.shape}".encode() + value.tobytes()
    elif isinstance(value, EnumMeta):
        yield from _pieces(tuple(value.__members__.items()), seen)
    elif isinstance(value, Enum):
        yield from _pieces((value.name, value.value), seen)
    elif isinstance(value, tuple | frozenset):
        yield repr(getattr(value, "_fields", ())).encode()  # fields of a named tuple
        for each in value if isinstance(value, tuple) else sorted(value, key=repr):
            yield from _pieces(each, seen)
    elif isinstance(value, _PLAIN):
        yield repr(value).encode()
    elif not isinstance(value, ModuleType):
        # A kernel or ufunc that Numba made keeps its function as Python's wrappers do.
        made = type(value).__module__.startswith("numba.")
        function = getattr(value, "__wrapped__", value) if made else value
        module = str(getattr(function, "__module__", None))
        if module.partition(".")[0] != _OURS and id(function) not in seen:
            seen.add(id(function))
            yield _source_of(module)  # the whole file: Numba may compile more of it, as of a class
            if isinstance(function, FunctionType):
                yield from _of_function(function, seen)


@cache
def _source_of(module: str) -> bytes:
    file = Path(str(getattr(sys.modules.get(module), "__file__", None)))
    return file.read_bytes() if file.suffix == ".py" and file.is_file() else b""


def _of_function(function: FunctionType, seen: set[int]) -> Iterator[bytes]:
    names: list[str] = []
    for code in _codes(function.__code__):
        yield code.co_code
        names += code.co_names
        for constant in code.co_consts:
            yield from _pieces(constant, seen)
    known = function.__globals__
    modules = [known[name] for name in names if isinstance(known.get(name), ModuleType)]
    for module in modules:  # grows by the modules inside these
        inner = [vars(module).get(name) for name in names]
        modules += [each for each in inner if isinstance(each, ModuleType) and each not in modules]
    for name in names:
        yield name.encode()
        yield from _pieces(known.get(name), seen)
        for module in modules:  # the name may be an attribute of that module
            yield from _pieces(vars(module).get(name), seen)
    for cell in function.__closure__ or ():
        yield from _pieces(cell.cell_contents, seen)
    yield from _pieces(function.__defaults__, seen)


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)
