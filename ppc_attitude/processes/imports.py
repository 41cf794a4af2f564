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

"""How our processes import: nothing from the folder where the user stands, and no more than we use.

Packages that read settings from the folder where the user stands are imported from another one: a
`matplotlibrc` there could start LaTeX, a `.numba_config.yaml` choose what is compiled, and either
be a FIFO that never ends. OpenBLAS, which NumPy and SciPy load a copy of each, starts no threads:
our matrices are small, and its threads took a sixth of the processor time of a node's start.
"""

import os
import sys
from collections.abc import Callable, MutableMapping, Sequence
from functools import partial
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType

_READ_SETTINGS = ("matplotlib", "numba")
# An empty entry of these means the current folder: for programs, modules and libraries.
_SEARCHED = ("PATH", "PYTHONPATH", "LD_LIBRARY_PATH")


def _execute_elsewhere(execute: Callable[[ModuleType], None], module: ModuleType) -> None:
    try:
        here = os.open(".", getattr(os, "O_PATH", os.O_RDONLY))
    except PermissionError:  # this user may not enter it, and reads nothing there
        execute(module)
        return
    try:
        os.chdir(os.sep)
        execute(module)
        if module.__name__ == "numba":  # its compiler would look there again
            vars(sys.modules["numba.core.config"])["_config_fname"] = ""
    finally:
        os.fchdir(here)
        os.close(here)


def prepare_imports() -> None:
    """Let this process import these packages from elsewhere, and let OpenBLAS start no threads."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.meta_path.insert(0, _Finder)


class _Finder(PathFinder):
    @classmethod
    def find_spec(
        cls, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find one of these modules; leave the others to other finders."""
        spec = super().find_spec(fullname, path, target) if fullname in _READ_SETTINGS else None
        if spec is not None and spec.loader is not None:
            execute = partial(_execute_elsewhere, spec.loader.exec_module)
            vars(spec.loader)["exec_module"] = execute
        return spec


def drop_empty_entries(environment: MutableMapping[str, str]) -> None:
    """Let nothing empty in an environment name the current folder."""
    if not environment.get("XDG_CACHE_HOME", "-"):  # Numba would keep and load machine code here
        del environment["XDG_CACHE_HOME"]
    for name in _SEARCHED:
        entries = [each for each in environment.pop(name, "").split(os.pathsep) if each]
        if entries:
            environment[name] = os.pathsep.join(entries)


def forget_current_folder() -> None:
    """Read nothing from the current folder, and leave it out of paths, unless somebody named it.

    Python puts it before the standard library, for ``-m`` or an empty entry of PYTHONPATH.
    """
    drop_empty_entries(os.environ)
    library = str(Path(os.__file__).parent)
    if library in sys.path:
        first = sys.path.index(library)
        entries = os.environ.get("PYTHONPATH", "").split(os.pathsep)
        named = {str(Path(each).absolute()) for each in entries if each}
        sys.path[:first] = [
            each for each in sys.path[:first] if each in named or each.endswith(".zip")
        ]
    prepare_imports()
