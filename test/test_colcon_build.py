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

"""A colcon workspace with this package builds; `ros2 run` and `ros2 pkg` find their files in it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from test_layers import PACKAGE, ROOT

import ppc_attitude
from ppc_attitude.contract.topics import MARKERS, NODES

GENERATED = {"bags", "build", "install", "log", f"{PACKAGE}.egg-info"}
SHARED_FILES = [
    path.relative_to(ROOT)
    for folder in ("config", "launch")
    for path in (ROOT / folder).rglob("*")
    if path.is_file() and path.parent.name != "__pycache__"
]


def not_source(folder: str, names: list[str]) -> set[str]:
    """Choose what of a folder does not belong into the copy."""
    if Path(folder) == ROOT:
        return {name for name in names if name.startswith(".") or name in GENERATED}
    return {"__pycache__"}


def run(command: list[str], workspace: Path) -> str:
    """Run a command as in a new terminal where no workspace is sourced, return what it printed."""
    sourced = ("AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH", "PYTHONPATH")
    environment = {name: value for name, value in os.environ.items() if name not in sourced}
    done = subprocess.run(
        command, cwd=workspace, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(
    scope="module", params=[[], ["--symlink-install"]], ids=["install", "symlink-install"]
)
def workspace(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build a workspace with a copy of this repository."""
    folder = tmp_path_factory.mktemp("workspace")
    shutil.copytree(ROOT, folder / "src" / PACKAGE, ignore=not_source)
    colcon = [sys.executable, "-m", "colcon", "build", "--base-paths", "src"]
    run([*colcon, "--packages-select", PACKAGE, *request.param], folder)
    return folder


def test_executables_are_where_ros2_run_looks(workspace: Path) -> None:
    folder = workspace / "install" / PACKAGE / "lib" / PACKAGE
    assert {path.name for path in folder.iterdir()} == {*NODES, MARKERS, PACKAGE}
    assert all(os.access(path, os.X_OK) for path in folder.iterdir())


def test_index_and_shared_files_are_where_ros2_pkg_looks(workspace: Path) -> None:
    share = workspace / "install" / PACKAGE / "share"
    assert (share / "ament_index" / "resource_index" / "packages" / PACKAGE).is_file()
    for file in [Path("package.xml"), *SHARED_FILES]:
        assert (share / PACKAGE / file).read_bytes() == (ROOT / file).read_bytes()


def test_sourced_workspace_runs_what_it_built(workspace: Path) -> None:
    code = "import ppc_attitude as p; print(p.__file__, p.__version__)"
    script = f"source install/setup.bash && {sys.executable!r} -c {code!r}"
    file, version = run(["bash", "-c", script], workspace).split()
    assert Path(file).resolve().is_relative_to(workspace.resolve())
    assert version == ppc_attitude.__version__
    script = f"source install/setup.bash && install/{PACKAGE}/lib/{PACKAGE}/{PACKAGE} --help"
    assert PACKAGE in run(["bash", "-c", script], workspace)
