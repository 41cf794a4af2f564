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

"""Fixtures of the whole suite: a ROS graph of its own for each test, processes that end with it."""

import contextlib
import fcntl
import gc
import itertools
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Iterator
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple, Protocol
from unittest import mock

import hypothesis
import pytest

from ppc_attitude.command_line.main import main
from ppc_attitude.nodes.discovery import DOMAINS, unused_domains
from ppc_attitude.processes.imports import prepare_imports

prepare_imports()  # as a command does; with threads of OpenBLAS it could not copy itself for nodes

# What is imported stays: looking through it for garbage took a twentieth of the suite's time.
gc.disable()

# A slow machine is no failure; the same examples every time, so that a failure can be repeated.
hypothesis.settings.register_profile("ppc_attitude", deadline=None, derandomize=True)
hypothesis.settings.load_profile("ppc_attitude")
# Else it draws numbers of the source that is loaded, and what a worker has loaded is chance.
with contextlib.suppress(ImportError, AttributeError):  # it is no promise of Hypothesis
    mock.patch(
        "hypothesis.internal.conjecture.providers.is_local_module_file", lambda path: False
    ).start()

# Tests that need what is not everywhere: rosdep has a key for neither Parquet nor Dask, `ros2
# launch` is not on PyPI and finds only what a sourced workspace has installed.
_NEEDS = {"test_campaign*.py": ("pyarrow", "distributed"), "test_launch.py": ("ros2launch",)}
_LEFT_OUT = {
    files: missing
    for files, modules in _NEEDS.items()
    if (missing := [name for name in modules if find_spec(name) is None])
}
collect_ignore_glob = list(_LEFT_OUT)
os.environ["TQDM_MININTERVAL"] = "0.1"  # [s] the tests take the time of a run from its bar

_PATIENCE = 60.0  # [s] a machine may be busy
_TURN = itertools.count(os.getpid())


def pytest_report_header() -> list[str]:
    """Say what is left out."""
    return [f"{files} left out: no {', '.join(missing)}" for files, missing in _LEFT_OUT.items()]


def pytest_collection_finish() -> None:
    """Collect garbage from now on, of what the tests make, and not after every 700 objects."""
    gc.freeze()
    gc.enable()
    gc.set_threshold(50_000, 20)


class StartProcess(Protocol):
    """Starts a process in a session of its own; the arguments are those of `subprocess.Popen`."""

    def __call__(self, command: list[str], **popen_arguments: Any) -> subprocess.Popen[str]: ...


@contextlib.contextmanager
def _own_domain() -> Iterator[int]:
    """Hold a domain that no other test holds, in this session or another on this machine.

    The lock is the kernel's: it goes with the process, however that ends.
    """
    folder = Path(tempfile.gettempdir()) / f"ppc_attitude_domains_{os.getuid()}"
    folder.mkdir(exist_ok=True)
    # Another one for each test: what one leaves in its graph is no part of the next one's.
    start = next(_TURN) % len(DOMAINS)
    unused = set(unused_domains())
    for domain in (*DOMAINS[start:], *DOMAINS[:start]):
        if domain not in unused:
            continue
        with (folder / str(domain)).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain
            return
    raise RuntimeError(
        f"all {len(DOMAINS)} ROS domains are taken, by locks in {folder} or by others"
    )


def _graph_of_its_own(domain: int, folder: Path) -> dict[str, str]:
    """Environment of processes that meet nobody else; their logs go into the folder."""
    return {
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(folder / "ros_log"),
        "ROS_PYTHON_CHECK_FIELDS": "1",
    }


@pytest.fixture(autouse=True)
def ros_domain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Give the test, and every process that it starts, a ROS graph of its own on this machine.

    A command that runs in this process may set what the middleware reads; it does not outlive
    the test.
    """
    with _own_domain() as domain:
        logs = tmp_path_factory.getbasetemp()  # to make a folder takes longer than many a test
        with mock.patch.dict(os.environ, _graph_of_its_own(domain, logs)):
            yield domain
        # A later test may get this domain. A process that was killed holds its sockets for a while.
        end = time.monotonic() + _PATIENCE
        while domain not in unused_domains():
            assert time.monotonic() < end, f"a participant is left in domain {domain}"
            time.sleep(0.01)


def _processes_with(mark: str) -> list[int]:
    """Find the processes whose environment at their start had the text."""
    found = []
    for environment in Path("/proc").glob("[0-9]*/environ"):
        with contextlib.suppress(OSError):  # it ended meanwhile, or is another user's
            if mark.encode() in environment.read_bytes():
                found.append(int(environment.parent.name))
    return found


@pytest.fixture
def start_process() -> Iterator[StartProcess]:
    """Give a function that starts a process; its whole family is gone when the test ends.

    The family inherits a mark in the environment, so it is found whatever its process groups
    and whether or not its parents live.
    """
    mark = f"PPC_ATTITUDE_TEST={uuid.uuid4()}"
    started: list[subprocess.Popen[str]] = []

    def start(command: list[str], **popen_arguments: Any) -> subprocess.Popen[str]:
        arguments = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **popen_arguments}
        environment = dict(arguments.pop("env", os.environ))
        environment.update([mark.split("=")])
        process = subprocess.Popen(
            command, text=True, start_new_session=True, env=environment, **arguments
        )
        started.append(process)
        return process

    yield start
    while family := _processes_with(mark):
        for pid in family:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        for process in started:
            process.communicate(timeout=_PATIENCE)
    for process in started:
        process.communicate(timeout=_PATIENCE)


class Answer(NamedTuple):
    """What a command has printed."""

    out: str
    err: str

    @property
    def page(self) -> str:
        """Standard output, wherever its lines were broken."""
        return " ".join(self.out.split())

    @property
    def json(self) -> Any:
        return json.loads(self.out)


class Ask(Protocol):
    """Runs a command in this process, which ends with this exit code."""

    def __call__(self, *words: object, code: int = 0) -> Answer: ...


@pytest.fixture
def ask(capsys: pytest.CaptureFixture[str]) -> Ask:
    """Give a function that runs a command of `ppc_attitude`."""

    def ask(*words: object, code: int = 0) -> Answer:
        try:
            ended: object = main(list(map(str, words)))
        except SystemExit as end:
            ended = end.code
        answer = Answer(*capsys.readouterr())
        assert ended == code, answer.err
        return answer

    return ask


@contextlib.contextmanager
def nothing_drawn() -> Iterator[None]:
    """Leave the drawings empty: what a test reads is in the text, and drawing takes seconds."""
    with mock.patch(
        "matplotlib.figure.Figure.savefig", lambda self, file, **_: file.write(b"<svg/>")
    ):
        yield


@pytest.fixture
def undrawn() -> Iterator[None]:
    """Let the test draw nothing."""
    with nothing_drawn():
        yield


@contextlib.contextmanager
def coarse_cells() -> Iterator[None]:
    """Let gains be searched on coarse cells, in half the time; they are proved on fine ones.

    The bounds of the reference are sought on a coarser grid. Commands evaluate the proof with
    floats, and promise one time only beside what is asked for, because `test_guarantee` proves
    all of it of the shipped laws with balls, and finds that floats say the same.
    """
    from ppc_attitude.command_line import guarantee_view  # NumPy, after `prepare_imports`
    from ppc_attitude.command_line.commands import design as command
    from ppc_attitude.science.guarantee import cells, design
    from ppc_attitude.science.guarantee.arithmetic import FLOATS
    from ppc_attitude.science.references import paper

    with (
        mock.patch.object(design, "FINE", cells.COARSE),
        mock.patch.object(paper, "_SEARCHED", 0.01),
        mock.patch.object(command, "certify", partial(command.certify, arithmetic=FLOATS)),
        mock.patch.object(guarantee_view, "balls", lambda: FLOATS),
        mock.patch.object(command, "RATES", (1.0,)),
        mock.patch.object(guarantee_view, "RATES", (1.0,)),
    ):
        yield


@pytest.fixture
def coarse() -> Iterator[None]:
    """Let the test search gains on coarse cells."""
    with coarse_cells():
        yield


@pytest.fixture(params=["mcap", "sqlite3"])
def storage(request: pytest.FixtureRequest) -> str:
    """Let the test have bags of either storage."""
    return str(request.param)


@pytest.fixture(scope="session")
def recorded_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the bag of two simulated seconds of the paper's case through all five nodes.

    A test that changes it works on a copy. The workers of one session share it: the first records.
    What the run said lies beside it, in `out`, `err` and `ros_log`.
    """
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    with (folder / "recorded.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "recorded").exists():
            _record(folder / "recording")
            (folder / "recording").rename(folder / "recorded")
    return folder / "recorded" / "bag"


def _record(folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    paced = folder / "paced.yaml"  # slow enough that health is recorded too
    paced.write_text("/**/spacecraft_plant:\n  ros__parameters:\n    real_time_factor: 1.0\n")
    command = [sys.executable, "-m", "ppc_attitude.command_line.main", "run"]
    options = ["--config", str(paced), "--duration", "2", "--bag", str(folder / "bag")]
    with _own_domain() as domain:
        done = subprocess.run(
            [*command, *options],
            env={**os.environ, **_graph_of_its_own(domain, folder)},
            capture_output=True,
            text=True,
            timeout=4.0 * _PATIENCE,
            check=False,
        )
    assert done.returncode == 0, done.stderr  # two seconds are too short to settle
    assert done.stdout.splitlines()[-1] == f"bag: {folder / 'bag'}"
    (folder / "out").write_text(done.stdout)
    (folder / "err").write_text(done.stderr)
