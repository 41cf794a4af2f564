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

"""The spine over real DDS: `run` gives what `simulate` gives, and ends as it should."""

import json
import os
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from process_helpers import PATIENCE, until

from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line.main import main
from ppc_attitude.contract.topics import CONTROLLER, INJECTOR, NODES, PLANT, RECORDER
from ppc_attitude.nodes.onlooker import looking_on
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.replay import replay
from ppc_attitude.simulation.scenario import load

PAPER = Path(__file__).parents[1] / "config" / "paper.yaml"
COMMAND = [sys.executable, "-m", "ppc_attitude.command_line.main"]

pytestmark = pytest.mark.ros


def finished(process, timeout=PATIENCE):
    out, err = process.communicate(timeout=timeout)
    return process.returncode, out, err


def run_of(start_process, bag, *options):
    return start_process([*COMMAND, "run", "--config", str(PAPER), "--bag", str(bag), *options])


def wait_for_line(stream, text):
    for line in stream:
        if text in line:
            return line
    raise AssertionError(f"ended without {text!r}")


@pytest.mark.slow
def test_two_runs_and_simulate_agree_to_the_last_bit(tmp_path, start_process):
    bags = [tmp_path / name for name in ("one", "two")]
    for bag in bags:
        code, out, err = finished(run_of(start_process, bag, "--duration", "4"))
        assert code == 0, err  # four seconds are too short to settle
        assert out.splitlines()[-1] == f"bag: {bag}"
        assert "4.0/4.0 s" in err.splitlines()[-1]  # the bar ends at the end
        assert "[INFO]" not in err
    logs = [path.read_text() for path in Path(os.environ["ROS_LOG_DIR"]).glob("*.log")]
    assert sum("ends: what it was to do is done" in log for log in logs) == len(bags), "the plants"
    assert sum("ends: it was asked to" in log for log in logs) == len(bags) * (len(NODES) - 1)
    expected = simulate(load([PAPER]), 4.0)
    for bag in bags:
        record = read_run(bag)
        assert record.missing_messages == 0
        assert not record.warnings
        assert replay(record).law.largest == 0.0
        assert np.array_equal(record.stamps_ns, expected.stamps_ns)
        assert record.columns.keys() == expected.columns.keys()
        for column, samples in expected.columns.items():
            assert np.array_equal(record.columns[column], samples), column


def wait_for_health(name):
    with looking_on("") as onlooker:
        until(lambda: name in str(onlooker.look(0.1).health), f"the health of {name}")


@pytest.mark.parametrize(
    "number",
    [pytest.param(signal.SIGINT, marks=pytest.mark.long), signal.SIGTERM],
    ids=lambda n: n.name,
)
def test_every_node_alone_ends_cleanly(tmp_path, start_process, number):
    processes = {}
    for name in NODES:
        # Who joins late gets no history, so the bag is complete only if all wait for the recorder.
        arguments = ["--ros-args", "-p", "wait_for_recorder:=true"] if name != RECORDER else []
        arguments += ["-p", "lockstep:=true"] if name == PLANT else []
        command = [sys.executable, "-m", f"ppc_attitude.nodes.{name}", *arguments]
        processes[name] = start_process(command, cwd=tmp_path)
    for name in processes:
        # Diagnostics of an idle node begin after the subscriptions: it is up.
        wait_for_health(name)
    for process in processes.values():
        process.send_signal(number)
    for name, process in processes.items():
        code, _, err = finished(process)
        assert code == 0, (name, err)
        assert "Traceback" not in err
        assert err.count("ends: it was asked to") == 1, (name, err)
    (bag,) = (tmp_path / "bags").iterdir()
    assert (bag / "metadata.yaml").exists()


BAD = {
    "infeasible table": (
        CONTROLLER,
        "rate_envelope: {exponential_terminal: 1.0e-6}",
        "rate_envelope",
    ),
    "inertia that is not positive definite": (
        PLANT,
        "inertia: [-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]",
        "positive definite",
    ),
    "wrong length": (PLANT, "initial_attitude: [0.0, 1.0]", "initial_attitude"),
    "NaN": (PLANT, "max_torque: .nan", "max_torque"),
    "unknown name": (INJECTOR, "enviroment: true", "environment"),
    "missing file": (PLANT, None, "nowhere.yaml"),
}


def test_bad_configuration_is_refused_by_commands_and_node(
    tmp_path, start_process, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    refused = {}
    for case, (node, text, _) in BAD.items():
        path = tmp_path / ("nowhere.yaml" if text is None else f"{case}.yaml")
        if text is not None:
            path.write_text(f"/**/{node}:\n  ros__parameters:\n    {text}\n")
        files = ["--params-file", str(PAPER), "--params-file", str(path)]
        command = [sys.executable, "-m", f"ppc_attitude.nodes.{node}", "--ros-args", *files]
        refused[case] = start_process(command)
        for name in ("run", "simulate", "check"):
            code = main([name, "--config", str(PAPER), "--config", str(path)])
            expect_refusal(case, name, code, capsys.readouterr().err)
    for case, process in refused.items():
        code, _, err = finished(process)
        expect_refusal(case, "node", code, err)
    assert not (tmp_path / "bags").exists()


def expect_refusal(case, name, code, err):
    assert code == 2, (case, name, err)
    assert BAD[case][2] in err, (case, name)
    assert "Traceback" not in err


WRONG = {
    "forgotten --ros-args": (["-p", "storage:=mcap"], "argument -p: what is for ROS follows --ros"),
    "file that is not there": (["--ros-args", "--params-file", "nowhere.yaml"], "nowhere.yaml"),
    "unknown name": (["--ros-args", "-p", "speed:=1.0"], "no parameter speed"),
    "wrong choice": (["--ros-args", "-p", "storage:=tape"], "one of mcap, sqlite3"),
    "no namespace": (["--ros-args", "-p", "namespaces:=[]"], "allowed: at least one"),
    "impossible namespace": (["--ros-args", "-p", "namespaces:=[a-b]"], "a-b"),
    "half a remapping": (["--ros-args", "-r", "half"], "half"),
}


def test_a_node_tells_wrong_arguments_and_leaves_nothing(tmp_path, start_process):
    started = {
        case: start_process(
            [sys.executable, "-m", f"ppc_attitude.nodes.{RECORDER}", *arguments], cwd=tmp_path
        )
        for case, (arguments, _) in WRONG.items()
    }
    for case, process in started.items():
        code, _, err = finished(process)
        assert code == 2, (case, err)
        assert WRONG[case][1] in err.splitlines()[-1]
        assert "Traceback" not in err
    assert list(tmp_path.glob("bags/*")) == []


def test_an_existing_bag_is_never_overwritten(tmp_path, start_process):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "mine").write_text("keep")
    code, _, err = finished(run_of(start_process, tmp_path / "bag"))
    assert code == 2
    assert "exists" in err
    command = [sys.executable, "-m", f"ppc_attitude.nodes.{RECORDER}", "--ros-args"]
    recorder = start_process([*command, "-p", f"bag:={tmp_path / 'bag'}"])
    code, _, err = finished(recorder)
    assert code == 2
    assert "bag" in err
    assert [path.name for path in (tmp_path / "bag").iterdir()] == ["mine"]


def test_the_bag_of_an_interrupted_run_can_be_read(tmp_path, start_process):
    process = run_of(start_process, tmp_path / "bag", "--duration", "10000")
    while " 0.0/10000.0 s [" in wait_for_line(process.stderr, "/10000.0 s ["):
        pass  # time has not begun
    for _ in range(2):  # Ctrl-C twice
        process.send_signal(signal.SIGINT)
    code, _, err = finished(process)
    assert code == 3
    assert "Traceback" not in err
    assert (tmp_path / "bag" / "metadata.yaml").exists()
    analysis = start_process([*COMMAND, "analyse", str(tmp_path / "bag"), "--json"])
    code, out, _ = finished(analysis)
    assert code == 0
    assert json.loads(out)["missing_messages"] == 0


@pytest.mark.long
def test_latency_is_that_of_a_run_with_its_bag_and_verdict(tmp_path, start_process):
    bag = tmp_path / "bag"
    options = ["--rate", "50", "--duration", "5", "--bag", str(bag)]
    code, out, err = finished(
        start_process([*COMMAND, "latency", "--config", str(PAPER), *options])
    )
    assert code in (0, 3), err  # a busy machine may lose some
    assert out.startswith("states ")
    assert "deadline 20 ms" in out
    assert "state to torque: p50" in out
    assert out.splitlines()[-1] == f"bag: {bag}"
    assert read_run(bag).parameters[PLANT]["rate"] == 50.0
