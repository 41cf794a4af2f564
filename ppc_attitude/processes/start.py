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

"""The script that every process we start begins with: ``start.py PARENT PIPE MODULE ARGUMENT…``.

It calls the `main` of the module. ``python -m`` would put the folder in which the user stands on
the path, and a `yaml.py` there would be executed. Python has an option for this from 3.11 on; -I,
which 3.10 has, would drop the PYTHONPATH too, and ROS needs that.
"""

import sys
from importlib import import_module
from pathlib import Path


def _main() -> None:
    parent, pipe, *call = sys.argv[1:]
    # Python has put the folder of this script first on the path, unless it was told not to.
    here = Path(__file__).resolve().parent
    sys.path[:] = [folder for folder in sys.path if folder != str(here)]
    # The package that this script belongs to, whatever else is installed or on the path.
    root = str(here.parent.parent)
    sys.path.insert(0, root)
    child = import_module("ppc_attitude.processes.child")
    imports = import_module("ppc_attitude.processes.imports")
    sys.path.remove(root)
    imports.prepare_imports()
    sys.exit(child.begin(int(parent), int(pipe), *call))


if __name__ == "__main__":
    _main()
