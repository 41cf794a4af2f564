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

"""A package of somebody else's, as it is installed for tests, and processes that find it."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from process_helpers import ran

OUTSIDE = Path(__file__).parent / "outside"
# Entry points of each kind.
POINTS = {
    "plants": "ringed = outside_parts:PLANT",
    "sensors": "rounding = outside_parts:SENSORS",
    "estimators": "two_rates = outside_parts:ESTIMATOR",
    "references": "turn = outside_parts:REFERENCE",
    "controllers": "share = outside_parts:LAW",
    "environments": "pushes = outside_parts:ENVIRONMENT",
    "actuators": "held = outside_parts:ACTUATOR",
}
COMMAND = "import sys; from ppc_attitude.command_line.main import main; sys.exit(main())"
Run = Callable[..., subprocess.CompletedProcess[str]]


def package(folder: Path) -> dict[str, str]:
    """Environment in which the package of somebody else's is installed, in a folder."""
    installed = folder / "installed" / "outside_parts-1.0.dist-info"
    installed.mkdir(parents=True)
    (installed / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: outside_parts\nVersion: 1.0\n"
    )
    name_points(folder, **POINTS)
    paths = [str(installed.parent), str(OUTSIDE), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}


def name_points(tmp_path: Path, **points: str) -> None:
    """Let the package have these entry points of each kind, and no others."""
    text = "".join(f"[ppc_attitude.{kind}]\n{lines}\n" for kind, lines in points.items())
    (tmp_path / "installed/outside_parts-1.0.dist-info/entry_points.txt").write_text(text)


def runs(folder: Path) -> Run:
    """Give a function that runs a script, or a command, where the package is installed."""
    environment = package(folder)

    def run(*words: str, script: str = COMMAND, code: int = 0) -> subprocess.CompletedProcess[str]:
        return ran([sys.executable, "-c", script, *words], code, env=environment, cwd=folder)

    return run
