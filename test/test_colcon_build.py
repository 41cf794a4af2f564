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

"""A colcon workspace with this package builds, runs and is tested; ROS finds its files in it."""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import StartProcess
from craft_helpers import ROOT
from process_helpers import PATIENCE
from test_layers import PACKAGE

import ppc_attitude
from ppc_attitude.contract.topics import MARKERS, OF_A_RUN, PLANT, RECORDER

GENERATED = {"bags", "build", "install", "log", f"{PACKAGE}.egg-info"}
SHARED_FILES = [
    path.relative_to(ROOT)
    for folder in ("config", "launch")
    for path in (ROOT / folder).rglob("*")
    if path.is_file() and path.parent.name != "__pycache__"
]


def not_source(folder: str, names: list[str]) -> set[str]:
    if Path(folder) == ROOT:
        return {name for name in names if name.startswith(".") or name in GENERATED}
    return {"__pycache__"}


def new_terminal() -> dict[str, str]:
    """Environment where no workspace is sourced."""
    sourced = ("AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH", "PYTHONPATH")
    return {name: value for name, value in os.environ.items() if name not in sourced}


def run(command: list[str], workspace: Path, code: int = 0) -> subprocess.CompletedProcess[str]:
    """Run a command as in a new terminal, which ends with this exit code."""
    done = subprocess.run(
        command, cwd=workspace, env=new_terminal(), capture_output=True, text=True, check=False
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done


def in_workspace(command: str) -> list[str]:
    """A command of a terminal where the workspace is sourced."""
    return ["bash", "-c", f"source install/setup.bash && {command}"]


def colcon(verb: str, *arguments: str) -> list[str]:
    return [sys.executable, "-m", "colcon", verb, *arguments]


@pytest.fixture(
    scope="module",
    params=["", pytest.param("--symlink-install", marks=pytest.mark.long)],
    ids=["install", "symlinks"],
)
def workspace(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build a workspace with a copy of this repository."""
    folder = tmp_path_factory.mktemp("workspace")
    shutil.copytree(ROOT, folder / "src" / PACKAGE, ignore=not_source)
    run(colcon("build", "--base-paths", "src", *request.param.split()), folder)
    return folder


def test_executables_are_where_ros2_run_looks(workspace: Path) -> None:
    folder = workspace / "install" / PACKAGE / "lib" / PACKAGE
    assert {path.name for path in folder.iterdir()} == {*OF_A_RUN, MARKERS, PACKAGE}
    assert all(os.access(path, os.X_OK) for path in folder.iterdir())


def test_index_and_shared_files_are_where_ros2_pkg_looks(workspace: Path) -> None:
    share = workspace / "install" / PACKAGE / "share"
    assert (share / "ament_index" / "resource_index" / "packages" / PACKAGE).is_file()
    for file in [Path("package.xml"), *SHARED_FILES]:
        assert (share / PACKAGE / file).read_bytes() == (ROOT / file).read_bytes()


def test_sourced_workspace_runs_what_it_built(workspace: Path) -> None:
    code = (
        "import ppc_attitude as p; from ppc_attitude.nodes.discovery import ANYWHERE, THIS_HOST;"
        "print(p.__file__, p.__version__, ANYWHERE, THIS_HOST)"
    )
    told = run(in_workspace(f"{sys.executable!r} -c {code!r}"), workspace).stdout.split()
    file, version, *profiles = told
    assert Path(file).resolve().is_relative_to(workspace.resolve())
    assert version == ppc_attitude.__version__
    assert len(profiles) == 2
    assert all(Path(profile).is_file() for profile in profiles)


def test_the_index_leads_to_config_and_launch_files(workspace: Path) -> None:
    """What `ros2 launch ppc_attitude FILE` and `ros2 pkg prefix --share` look up."""
    pytest.importorskip("ament_index_python")
    code = (
        "from ament_index_python.packages import *;"
        f"print(get_package_prefix({PACKAGE!r}), get_package_share_directory({PACKAGE!r}))"
    )
    told = run(in_workspace(f'{sys.executable!r} -c "{code}"'), workspace).stdout
    prefix = workspace / "install" / PACKAGE
    assert [*map(Path, told.split())] == [prefix, prefix / "share" / PACKAGE]


def test_an_executable_finds_its_code(workspace: Path) -> None:
    """By the file that `ros2 run` executes."""
    command = f"install/{PACKAGE}/lib/{PACKAGE}/{PLANT} --ros-args -p speed:=1.0"
    assert "no parameter speed" in run(in_workspace(command), workspace, code=2).stderr


@pytest.mark.ros
@pytest.mark.long
def test_every_executable_runs(workspace: Path, start_process: StartProcess) -> None:
    """A moment of the paper's case by the files that `ros2 run` executes, and by the command."""
    files = f"install/{PACKAGE}/lib/{PACKAGE}"
    # First, and alone: it compiles the kernels for all.
    simulated = run(in_workspace(f"{files}/{PACKAGE} simulate --duration 1"), workspace)
    assert "not judged" in simulated.stdout

    def start(name: str, *arguments: str) -> subprocess.Popen[str]:
        command = f"exec {files}/{name} {shlex.join(['--ros-args', *arguments])}"
        return start_process(in_workspace(command), cwd=workspace, env=new_terminal())

    config = f"install/{PACKAGE}/share/{PACKAGE}/config/paper.yaml"
    waits = ["--params-file", config, "-p", "wait_for_recorder:=true"]
    others = [name for name in OF_A_RUN if name not in (PLANT, RECORDER)]
    peers = {name: start(name, *waits) for name in others}
    peers[MARKERS] = start(MARKERS, "--params-file", config)
    peers[RECORDER] = start(RECORDER, "-p", "bag:=bag")
    plant = start(PLANT, *waits, "-p", "lockstep:=true", "-p", "duration:=0.1")
    _, said = plant.communicate(timeout=PATIENCE)
    assert plant.returncode == 0, said
    for name, process in peers.items():
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, (name, said)
    assert (workspace / "bag" / "metadata.yaml").is_file()
    shutil.rmtree(workspace / "bag")


@pytest.mark.parametrize("workspace", [""], ids=["install"], indirect=True)
def test_colcon_test_tells_what_passes_and_what_fails(workspace: Path) -> None:
    fails = workspace / "src" / PACKAGE / "test" / "test_fails.py"
    fails.write_text("def test_passes(): ...\ndef test_fails():\n    assert False\n")
    run(colcon("test", "--base-paths", "src", "--pytest-args", "test/test_fails.py"), workspace)
    told = run(colcon("test-result", "--verbose"), workspace, code=1).stdout
    assert re.search(r"\b[1-9]\d* tests, 0 errors, 1 failure, 0 skipped", told), told
    assert "test_fails" in told
    fails.unlink()
