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

"""Commands end in good order: whatever becomes of their output, and whenever they are asked to."""

import os
import resource
import signal
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Event, Thread, current_thread, main_thread
from types import SimpleNamespace
from typing import Any

import pytest
from conftest import Ask, StartProcess
from craft_helpers import overlay
from process_helpers import (
    COMMAND,
    ENDLESS,
    PAPER,
    PATIENCE,
    Run,
    alive,
    pace,
    pause,
    ran,
    until,
)

from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line.commands import simulate
from ppc_attitude.command_line.options import REPORT
from ppc_attitude.command_line.stack import Stack, StackError
from ppc_attitude.contract.topics import CONTROLLER, NODES, PLANT, RECORDER
from ppc_attitude.processes.telling import AT, BROKEN, FINISHED, LINGERS
from ppc_attitude.simulation.scenario import load

long = pytest.mark.long
WORDS = ["simulate", "--config", str(PAPER), "--duration", "1"]
SIMULATE = [*COMMAND, *WORDS]
HELP = [*COMMAND, "recover", "--help"]  # what it imports takes the least time
FULL = "error: No space left on device\n"


@pytest.mark.parametrize(
    ("command", "outlets", "code", "told"),
    [
        pytest.param(SIMULATE, ">/dev/full", 3, FULL, marks=long),
        (HELP, ">/dev/full", 3, FULL),
        (SIMULATE, ">&- 2>&- <&-", 0, ""),
        ([*COMMAND, "recover", "none"], "2>/dev/full", 2, ""),
        ([*SIMULATE, "--json"], "| true", 3, ""),
    ],
    ids=lambda each: each if isinstance(each, str) else "",
)
def test_output_that_nobody_takes(
    command: list[str], outlets: str, code: int, told: str, start_process: StartProcess
) -> None:
    script = f'set -o pipefail; "$@" {outlets}'
    environment = {**os.environ, "PYTHONUNBUFFERED": ""}
    process = start_process(["bash", "-c", script, "bash", *command], env=environment)
    out, err = process.communicate(timeout=PATIENCE)
    assert (process.returncode, out, err) == (code, "", told)


def test_a_terminal_of_few_letters_gets_the_codes_of_others() -> None:
    assert r"\u2264 3 deg/s" in ran(SIMULATE, env={"PYTHONIOENCODING": "ascii"}).stdout


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    "options", ["--bag run", "--bag run --config stored.yaml", "--export t.csv", "--report r.html"]
)
def test_a_file_that_has_no_room_is_no_mistake_of_the_input(
    options: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ask: Ask
) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill(*_: object, **__: object) -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))

    overlay(tmp_path / "stored.yaml", {RECORDER: {"storage": "sqlite3"}})
    before = tmp_path / "before"
    before.mkdir()
    monkeypatch.chdir(before)
    (before / "stored.yaml").symlink_to(tmp_path / "stored.yaml")
    ask(*WORDS, *options.split())  # all kernels are compiled by then
    monkeypatch.setattr(simulate, "print_verdict", fill)
    # Else the compiled code of what is imported meanwhile would be cut short, too, and stay so.
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.chdir(tmp_path)
    try:
        told = ask(*WORDS, *options.split(), code=3).err
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert told.startswith("error: ") and options.split()[1] in told


def is_interrupted(process: "subprocess.Popen[str]") -> None:
    """It ends as what was asked to, and says so in one line."""
    _, err = process.communicate(timeout=PATIENCE)
    assert (process.returncode, err) == (3, "interrupted\n")


ASKED_AMIDST = """
import os, pathlib, signal
signal.signal({number}, signal.SIG_DFL)  # the tests may run under nohup
from matplotlib.figure import Figure
from ppc_attitude.command_line import main
Figure.savefig = lambda self, file, **_: None  # it takes seconds
replace = pathlib.Path.replace
def interrupted(path, target):
    if target.name == "report.html":
        os.kill(os.getpid(), {number})
    return replace(path, target)
pathlib.Path.replace = interrupted
main.run()
"""


@pytest.mark.parametrize(
    "name",
    ["SIGTERM", *(pytest.param(each, marks=long) for each in ("SIGINT", "SIGHUP", "SIGQUIT"))],
)
def test_an_end_while_the_report_is_written(
    name: str, tmp_path: Path, start_process: StartProcess
) -> None:
    before = f"<!DOCTYPE html>{REPORT}the one before"
    (tmp_path / "report.html").write_text(before)
    script = ASKED_AMIDST.format(number=int(signal.Signals[name]))
    options = [*WORDS, "--report", "report.html"]
    is_interrupted(start_process([sys.executable, "-c", script, *options], cwd=tmp_path))
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["report.html"]
    assert (tmp_path / "report.html").read_text() == before


def test_an_end_while_something_is_imported(tmp_path: Path, start_process: StartProcess) -> None:
    """A library that is loaded bears no exception: what came of one was a traceback."""
    (tmp_path / "tqdm.py").write_text(
        "import os, signal\n"
        "try:\n    os.kill(os.getpid(), signal.SIGTERM)\n"
        "except BaseException:\n    raise ImportError('initialization failed') from None\n"
    )
    command = [*COMMAND, "run", "--config", str(PAPER), "--bag", str(tmp_path / "bag")]
    is_interrupted(start_process(command, env={**os.environ, "PYTHONPATH": str(tmp_path)}))


AMIDST_EXEC = """
from ppc_attitude.command_line import main
from ppc_attitude.command_line.commands import simulate
simulate.tell_concerns = lambda *_: exec("import os; os.kill(os.getpid(), {number})")
main.run()
"""
LOST = """
import ctypes, os
from ppc_attitude.command_line import main
from ppc_attitude.command_line.commands import simulate
@ctypes.CFUNCTYPE(None)
def compiled():
    os.kill(os.getpid(), {number})
    pass  # here the handler is called; what it raises, a callback loses
def compiles(*_):
    compiled()
    raise RuntimeError("no compiled object yet")
simulate.tell_concerns = compiles
main.run()
"""


@pytest.mark.parametrize("script", [LOST, AMIDST_EXEC], ids=["compiler", "exec"])
def test_an_end_while_code_is_made(
    script: str, tmp_path: Path, start_process: StartProcess
) -> None:
    """A compiler loses the exception; of one that has left an `exec` Python dies at its end."""
    (tmp_path / "amidst.py").write_text(script.format(number=int(signal.SIGTERM)))
    command = [sys.executable, "-m", "amidst", *WORDS]
    is_interrupted(start_process(command, cwd=tmp_path))


AMIDST_LOOP = """
import os, threading
import {module} as computing
from ppc_attitude.command_line import main
from ppc_attitude.science.kernel import kernel
@kernel
def loop(odd):
    while odd != 0:
        odd *= 3
loop(0)
def endless(*_):
    threading.Timer(0.2, os.kill, (os.getpid(), {number})).start()
    loop(1)
computing.{name} = endless
main.run()
"""


COMPUTING = [
    ("run", "command_line.recording.warm_up"),
    ("simulate", "command_line.commands.simulate.simulate"),
    ("sweep", "command_line.commands.sweep.simulate"),
    ("check", "command_line.commands.check.first_instant"),
    ("campaign", "command_line.commands.campaign.warm_up"),
    ("campaign --only 1", "campaign.rows.simulate"),
    ("design --controller ppc", "command_line.gain_search.warm_up"),
    # These two prepare for a second before.
    ("falsify", "falsify.search.simulate"),
    ("design --controller ppc", "campaign.tuning.simulate"),
]


@pytest.mark.parametrize(
    ("words", "computing"),
    [*COMPUTING[:-2], *(pytest.param(*each, marks=long) for each in COMPUTING[-2:])],
)
def test_the_main_thread_stays_free_while_a_step_computes(
    words: str, computing: str, ask: Ask, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed: list[Thread] = []

    def compute(*_: object) -> None:
        computed.append(current_thread())
        raise ValueError("enough")

    monkeypatch.setattr(f"ppc_attitude.{computing}", compute)
    monkeypatch.chdir(tmp_path)
    ask(*words.split(), "--config", PAPER, code=2)
    assert computed
    assert main_thread() not in computed


@pytest.mark.parametrize(
    ("words", "computing"),
    [COMPUTING[0], *(pytest.param(*each, marks=long) for each in COMPUTING[1:])],
)
def test_an_end_while_a_step_computes_for_ever(
    words: str, computing: str, tmp_path: Path, start_process: StartProcess
) -> None:
    """The main thread heard of it only after the loop."""
    module, _, name = f"ppc_attitude.{computing}".rpartition(".")
    script = AMIDST_LOOP.format(module=module, name=name, number=int(signal.SIGTERM))
    (tmp_path / "amidst.py").write_text(script)
    command = [sys.executable, "-m", "amidst", *words.split(), "--config", str(PAPER)]
    process = start_process(command, cwd=tmp_path)
    _, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 3
    assert "interrupted" in err.splitlines()[-1]


def is_asked_to_end(paused: int) -> bool:
    """True if SIGINT waits for a paused process."""
    status = Path(f"/proc/{paused}/status").read_text()
    waiting = int(status.partition("ShdPnd:\t")[2].split()[0], 16)
    return bool(waiting >> (signal.SIGINT - 1) & 1)


@pytest.mark.ros
def test_a_run_that_is_interrupted_before_time_begins_leaves_no_bag(
    tmp_path: Path, start_process: StartProcess
) -> None:
    run = Run(start_process, tmp_path / "bag")
    plant = until(lambda: run.nodes().get(PLANT), "the plant")
    pause(plant)
    until(run.bag.exists, "the recorder")
    run.send(signal.SIGTERM)
    # Else time may begin before a run that waits for the processor hears of it.
    until(lambda: is_asked_to_end(plant), "the request to the plant")
    os.kill(plant, signal.SIGCONT)
    assert run.ends() == 3
    assert run.err.endswith("error: interrupted before anything was recorded\n")
    assert not run.bag.exists()


@pytest.mark.ros
@pytest.mark.parametrize(
    "name", ["SIGKILL", *(pytest.param(each, marks=long) for each in ("SIGHUP", "SIGQUIT"))]
)
def test_a_run_leaves_nothing_but_its_bag(
    name: str, tmp_path: Path, start_process: StartProcess
) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    environment = {**os.environ, "TMPDIR": str(temporary)}
    del environment["ROS_LOG_DIR"]
    options: dict[str, Any] = {"overlay": pace(2.0), "env": environment}
    # These tests may run by nohup, and a run would inherit that it does not heed SIGHUP.
    heeds = partial(signal.signal, signal.SIGHUP, signal.SIG_DFL)
    run = Run(start_process, tmp_path / "bag", *ENDLESS, **options, preexec_fn=heeds)
    run.reaches(0.5)
    nodes = run.nodes()
    assert nodes.keys() == set(NODES)
    run.send(signal.Signals[name])
    assert run.ends() == (-signal.SIGKILL if name == "SIGKILL" else 3)
    until(lambda: not any(map(alive, nodes.values())), "the end of the nodes, after their starter")
    assert list(temporary.iterdir()) == []
    assert (run.bag / "metadata.yaml").exists()
    record = read_run(run.bag)
    assert record.stamps_ns.size > 1
    assert record.missing_messages == 0 or name == "SIGKILL"


def test_a_plant_that_somebody_else_asks_to_end_has_not_finished() -> None:
    """It ends with 0, as one that has; the run would be taken for complete."""
    run = Stack(load([]), lambda simulated: None, [], {})
    ended = SimpleNamespace(pid=os.getpid(), poll=lambda: 0, returncode=0)
    told = dict[str, Any]()
    plant: Any = SimpleNamespace(process=ended, told=told, listen=lambda patience=0.0: None)
    run.nodes[PLANT] = plant
    why = f"{PLANT} ended with exit code 0: somebody else asked it to end"
    with pytest.raises(StackError, match=why):
        run.goes_on(Event())
    told[FINISHED] = True
    assert not run.goes_on(Event())
    ended.poll = lambda: None
    assert run.goes_on(Event())
    told[LINGERS] = True  # for others than those of the run
    assert not run.goes_on(Event())


@pytest.mark.ros
def test_of_several_nodes_that_broke_the_first_is_named() -> None:
    values = load([]).parameters
    wrong = replace(load([]), parameters={name: {**values[name], "no_such": 1} for name in values})
    run = Stack(wrong, lambda simulated: None, [CONTROLLER, RECORDER], os.environ)
    run.start()
    until(lambda: None not in run.exit_codes().values(), "the end of both")
    with pytest.raises(StackError) as error:
        run.stop()
    first = min(run.told().items(), key=lambda each: each[1][AT])
    assert str(error.value) == f"{first[0]} ended with exit code 2: {first[1][BROKEN]}"
    assert "no parameter no_such" in str(error.value)
