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

"""Packages that read settings from the folder where the user stands are imported from another one.

A `matplotlibrc` there could start LaTeX, a `.numba_config.yaml` choose what is compiled, and either
be a FIFO that never ends.
"""

import os
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType

_CURIOUS = ("matplotlib", "numba")


def import_elsewhere() -> None:
    """Let this process import these packages so."""
    sys.meta_path.insert(0, _Finder)


class _Finder(PathFinder):
    @classmethod
    def find_spec(
        cls, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find one of these packages; leave the others to other finders."""
        spec = super().find_spec(fullname, path, target) if fullname in _CURIOUS else None
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_elsewhere(module: ModuleType) -> None:
                here = os.open(".", getattr(os, "O_PATH", os.O_RDONLY))
                try:
                    os.chdir(os.sep)
                    execute(module)
                    if fullname == "numba":  # its compiler would look there again
                        vars(sys.modules["numba.core.config"])["_config_fname"] = ""
                finally:
                    os.fchdir(here)
                    os.close(here)

            vars(spec.loader)["exec_module"] = execute_elsewhere
        return spec
