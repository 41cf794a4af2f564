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

"""Processes execute nothing of where the user stands, tell why they break off, and end."""

import json
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from conftest import StartProcess
from process_helpers import PAPER, PATIENCE, pause, ran, until

import ppc_attitude.processes.child
from ppc_attitude.bags.reader import read_run
from ppc_attitude.contract.topics import INJECTOR
from ppc_attitude.processes.child import Child, starved
from ppc_attitude.processes.copied import Copy
from ppc_attitude.processes.telling import AT, BROKEN

COMMAND = str(Path(sys.executable).with_name("ppc_attitude"))
long = pytest.mark.long
OTHERS = ("matplotlib", "numba", "numpy", "pyarrow", "rclpy", "rosbags", "scipy", "yaml")


def set_traps(folder: Path, *names: str) -> None:
    """Put modules of these names into a folder; each tells that it was executed."""
    folder.mkdir()
    caught = folder.with_name("caught")
    caught.touch()
    for name in names:
        source = f"open({str(caught)!r}, 'a').write('{name} ')\nraise ImportError\n"
        (folder / f"{name}.py").write_text(source)


@pytest.fixture
def trap(tmp_path: Path) -> Path:
    """A folder with a module of every name that may be imported."""
    folder = tmp_path / "trap"
    set_traps(folder, *sys.stdlib_module_names, *OTHERS, "ppc_attitude")
    (folder / ".numba_config.yaml").write_text("[")  # Numba would fail that reads it
    os.mkfifo(folder / "matplotlibrc")  # who opened it would wait for ever
    return folder


SECOND = ["--config", str(PAPER), "--duration", "1"]
PAGE = ["--bag", "bag", "--report", "report.html"]
CALLS = {
    "simulate": ["simulate", *SECOND],
    "campaign": ["campaign", "--config", str(PAPER), "--runs", "4"],
    # The law with the fewest figures: what draws one imports all that draws.
    "run": ["run", "--controller", "quaternion_feedback", "--duration", "0.02", *PAGE],
    "latency": ["latency", *SECOND],
}


@pytest.mark.ros
@pytest.mark.parametrize(
    "call",
    [each if each == "run" else pytest.param(each, marks=long) for each in CALLS],
)
def test_a_command_executes_nothing_of_the_current_folder(
    call: str, trap: Path, start_process: StartProcess
) -> None:
    process = start_process([COMMAND, *CALLS[call]], cwd=trap)
    _, err = process.communicate(timeout=PATIENCE)
    assert trap.with_name("caught").read_text() == "", err
    assert process.returncode in (0, 1), err  # too short to settle
    if call == "run":  # it is over before the recorder would have found every publisher by itself
        run = read_run(trap / "bag")
        assert run.missing_messages == 0
        assert run.stamps_ns.tolist() == [0, 10_000_000, 20_000_000]


def test_a_compiler_looks_for_no_settings_in_the_current_folder(tmp_path: Path) -> None:
    """Numba reads them again before it compiles."""
    lines = (
        "from ppc_attitude.processes.imports import prepare_imports",
        "prepare_imports()",
        "import numba",
        "numba.core.config.reload_config()",
        "print(numba.config.CACHE_DIR)",
    )
    command = [sys.executable, "-c", "; ".join(lines)]
    (tmp_path / ".numba_config.yaml").write_text("cache_dir: elsewhere")
    assert "elsewhere" not in ran(command, cwd=tmp_path).stdout


BY_NAME = [sys.executable, "-m", "ppc_attitude.command_line.main"]


@pytest.mark.parametrize(
    ("command", "entries"),
    [
        (BY_NAME, ":"),
        pytest.param([COMMAND], ":", marks=long),
        pytest.param(BY_NAME, "", marks=long),
    ],
    ids=["both", "empty entry", "-m"],
)
def test_what_python_has_put_on_the_path_is_taken_from_it(
    command: list[str], entries: str, tmp_path: Path, start_process: StartProcess
) -> None:
    """Python itself may have looked there by then, so the traps are modules that only we import."""
    set_traps(tmp_path / "trap", *OTHERS)
    program = tmp_path / "trap" / "git"
    program.write_text(f"#!/bin/sh\necho git > {tmp_path / 'caught'}\n")
    program.chmod(0o755)
    process = start_process(
        [*command, *CALLS["simulate"]],
        cwd=tmp_path / "trap",
        env={**os.environ, "PYTHONPATH": entries, "PATH": f":{os.environ['PATH']}"},
    )
    _, err = process.communicate(timeout=PATIENCE)
    assert (tmp_path / "caught").read_text() == ""
    assert process.returncode == 0, err


@pytest.mark.parametrize(
    "entries",
    ["", "{named}::", *(pytest.param(each, marks=long) for each in (":{named}", "relative:"))],
)
def test_a_child_knows_the_named_folders_and_not_the_current_one(
    entries: str,
    trap: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    seen = tmp_path / "seen"
    for folder in (tmp_path / "named", trap / "relative"):
        folder.mkdir()
        # The package is that of the child's starter, though this one is first on the path.
        (folder / "ppc_attitude.py").write_text("raise ImportError('the wrong one')")
        # Python executes this at its start wherever it finds it.
        (folder / "sitecustomize.py").write_text(f"open({str(seen)!r}, 'w').write(__file__)")
    monkeypatch.chdir(trap)
    environment = {**os.environ, "PYTHONPATH": entries.format(named=tmp_path / "named")}
    code, _ = ended(Child(f"ppc_attitude.nodes.{INJECTOR}", "--help", environment=environment))
    assert trap.with_name("caught").read_text() == ""
    assert code == 0
    assert "parameters:" in capfd.readouterr().err
    assert seen.exists() == bool(entries.strip(":"))


@pytest.mark.ros
@pytest.mark.parametrize(
    ("module", "options", "reason"),
    [
        ("nodes.bag_recorder", ["-p", "storage:=tape"], "storage = 'tape'"),
        pytest.param("nodes.bag_recorder", ["-r", "half"], "half", marks=long),
        ("nodes.no_node", [], "No module named 'ppc_attitude.nodes.no_node'"),
    ],
)
def test_a_child_tells_why_it_breaks_off(
    module: str, options: list[str], reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    begin = time.monotonic()
    code, told = ended(Child(f"ppc_attitude.{module}", "--ros-args", *options))
    assert code != 0
    assert reason in told[BROKEN]
    assert begin < told[AT] < time.monotonic()


def ended(child: Child) -> tuple[int, dict[str, Any]]:
    """Exit code of a child that ends by itself, and what it has told."""
    code = child.process.wait(PATIENCE)
    child.listen()
    return code, child.told


STARTER = """
import json, os, sys, threading
import becoming
from ppc_attitude.processes.child import Child

becoming.is_copy = True
end = threading.Event()
if sys.argv[1] == "threads":
    threading.Thread(target=end.wait).start()
print("not yet written", end="")  # a copy must not write it too
hidden = os.dup2(0, 50)  # far from the number of what lists the open files
for each in ("3", "raise", "kill"):
    environment = {**os.environ, "DONE_BY": each}
    del environment["DONE_HERE"]
    child = Child("becoming", each, environment=environment, inherited=[2], copy=True)
    assert child.ends(60.0)
    child.listen()
    told = {**child.told, "code": child.process.poll(), "pid": child.process.pid, "hidden": hidden}
    print("\\n" + json.dumps(told), flush=True)  # else a piece of it, where a buffer is full
end.set()
"""
BECOMING = """
import os, signal, sys
from importlib.util import find_spec
from pathlib import Path
from ppc_attitude.processes.telling import tell, tell_broken

is_copy = False

def main():
    open_files = [int(file.name) for file in Path("/proc/self/fd").iterdir()]
    tell("is_copy", is_copy)
    tell("arguments", sys.argv[1:])
    tell("environment", [os.environ["DONE_BY"], "DONE_HERE" in os.environ])
    tell("leads", os.getsid(0))
    tell("listed", Path("/proc/self/cmdline").read_text())
    tell("input", os.read(0, 1).decode())
    tell("files", open_files)
    tell("stray", find_spec("telling") is not None)
    print("written")
    if sys.argv[1] == "raise":
        raise ValueError("wrong")
    if sys.argv[1] == "kill":
        tell_broken("this")
        tell_broken("what followed")
        os.kill(os.getpid(), signal.SIGKILL)
    return int(sys.argv[1])
"""


@pytest.mark.parametrize("threads", ["alone", "threads"])
def test_a_copy_is_a_process_like_any_other(
    threads: str, tmp_path: Path, start_process: StartProcess
) -> None:
    """Who has a thread cannot be copied, and starts another Python, to the same effect."""
    script = tmp_path / "becoming.py"
    script.write_text(BECOMING)
    settings = {"PYTHONPATH": str(tmp_path), "PYTHONUNBUFFERED": "", "DONE_HERE": ""}
    environment = {**os.environ, **settings}
    command = [sys.executable, "-c", STARTER, threads]
    with script.open() as given:  # the input of the copies is empty all the same
        process = start_process(command, env=environment, stdin=given)
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, err
    assert err.count("ValueError: wrong") == 1
    assert out.count("not yet written") == 1
    assert out.count("written") == 1, "what a child prints is no result"
    lines = [line for line in out.splitlines() if line.startswith("{")]
    for each, code, line in zip(("3", "raise", "kill"), (3, 1, -9), lines, strict=True):
        told = json.loads(line)
        assert told["code"] == code
        assert told["is_copy"] == (threads == "alone")
        assert told["arguments"] == [each]
        assert told["environment"] == [each, False]
        assert told["leads"] == told["pid"]
        assert "becoming" in told["listed"]
        assert told["input"] == ""
        assert told["hidden"] not in told["files"]
        assert not told["stray"]  # the folder of our script is not on the path
        assert told.get(BROKEN) == {"raise": "ValueError: wrong", "kill": "this"}.get(each)


def test_a_process_that_does_not_end_is_given_up() -> None:
    child = Child(f"ppc_attitude.nodes.{INJECTOR}")
    pause(child.process.pid)
    assert not child.ends(0.3)
    child.kill()


def test_a_copy_is_killed_though_it_leads_no_group_yet(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ppc_attitude.processes.child, "can_copy", lambda: True)
    monkeypatch.setattr(os, "setsid", lambda: time.sleep(20.0))
    child = Child("signal", copy=True)
    child.kill()
    assert child.process.poll() == -signal.SIGKILL


def test_a_process_that_hangs_says_where(tmp_path: Path) -> None:
    reached, said = tmp_path / "reached", list[str]()
    (tmp_path / "hangs.py").write_text(
        "import pathlib, signal, time\n"
        "def main():\n"
        "    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])\n"
        f"    pathlib.Path({str(reached)!r}).touch()\n"
        "    time.sleep(1000.0)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    child = Child("hangs", environment=environment, hear=said.append)
    try:
        until(reached.exists, "the hanging")
        child.process.send_signal(signal.SIGINT)
        assert not child.ends(0.1)
        until(
            lambda: any("hangs.py" in line and "in main" in line for line in said),
            "where it hangs",
            meanwhile=child.says_where,
        )
    finally:
        child.kill()


def test_all_that_a_process_says_is_heard_and_nothing_stays_open(tmp_path: Path) -> None:
    """More than its pipe holds, with a byte that is no letter, and without an end of the line."""
    (tmp_path / "says.py").write_text(
        "import os\ndef main():\n    os.write(2, 100_000 * b'caf\\xe9 ')"
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    said, files = list[str](), Path("/proc/self/fd")
    before = len(list(files.iterdir()))
    child = Child("says", environment=environment, hear=said.append)
    assert child.ends(PATIENCE)
    child.listen()
    assert "".join(said) == 100_000 * "caf\ufffd "
    del child
    assert len(list(files.iterdir())) <= before  # what others had open may be closed meanwhile


def test_a_node_that_is_slow_to_begin_ends_when_it_is_asked_to(tmp_path: Path) -> None:
    """Else its starter waits, and kills it: imports took half a minute on a busy machine."""
    reached = tmp_path / "reached"
    (tmp_path / "numba.py").write_text(
        f"import pathlib, time\npathlib.Path({str(reached)!r}).touch()\ntime.sleep(1000.0)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    child = Child(f"ppc_attitude.nodes.{INJECTOR}", environment=environment)
    try:
        until(reached.exists, "the import")
        child.process.send_signal(signal.SIGINT)
        assert child.process.wait(PATIENCE) == 0
    finally:
        child.kill()


def test_waiting_for_the_processor_is_no_reason_to_be_given_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As on a machine where the others leave a process nothing for a second."""
    child = Child(f"ppc_attitude.nodes.{INJECTOR}")
    pause(child.process.pid)
    begin = time.monotonic()

    def others_had_it(pid: int) -> float:
        if time.monotonic() - begin > 1.0:
            child.kill()
        return time.monotonic() - begin

    monkeypatch.setattr(ppc_attitude.processes.child, "starved", others_had_it)
    assert child.ends(0.3)


def test_who_shares_a_processor_waits_for_it(start_process: StartProcess) -> None:
    place = next(iter(os.sched_getaffinity(0)))
    busy = f"import os; os.sched_setaffinity(0, [{place}])\nwhile True: pass"
    one, _ = (start_process([sys.executable, "-c", busy]) for _ in range(2))
    until(lambda: starved(one.pid) > 0.1, "its turn")


def test_two_threads_may_look_for_the_end_of_a_copy() -> None:
    """The end of a process is told once, to one of them."""
    copy = Copy(lambda: os._exit(7))
    os.waitpid(copy.pid, 0)  # as another thread, which asks at the same time
    assert copy.poll() is None


HELD = """
import ctypes, sys
from ppc_attitude.nodes import running
from ppc_attitude.nodes.disturbance_injector import DisturbanceInjector
from ppc_attitude.processes import leaving

class Held(DisturbanceInjector):
    def __init__(self):
        super().__init__()
        self.finished, self.exit_code = True, 3

    def destroy_node(self):  # as rclpy does it: the middleware is waited for with Python's lock
        ctypes.PyDLL(None).sleep(600)

leaving._PATIENCE = 2
with leaving.leaving(7):  # who has left in time lives on
    pass
sys.exit(running.run_node(Held, ["node"]))
"""


@pytest.mark.ros
def test_a_node_that_its_middleware_does_not_let_go_ends_all_the_same() -> None:
    assert "in destroy_node" in ran([sys.executable, "-c", HELD], 3).stderr
