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

import gc
from dataclasses import replace

import numpy as np
import pytest
import yaml
from bag_helpers import assert_flown
from process_helpers import COMMAND, PAPER, PATIENCE, Run, node_here

from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line.main import main
from ppc_attitude.contract.topics import CONTROLLER, ESTIMATOR, INJECTOR, NODES, PLANT, RECORDER
from ppc_attitude.science.estimators import mekf
from ppc_attitude.science.kinds import ESTIMATORS
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import load

pytestmark = pytest.mark.ros


def test_a_run_and_the_loop_in_process_agree_to_the_last_bit(recorded_bag):
    said = (recorded_bag.parent / "err").read_text()
    assert "2.0/2.0 s" in said.splitlines()[-1]  # the bar ends at the end
    assert "[INFO]" not in said
    logs = [path.read_text() for path in (recorded_bag.parent / "ros_log").glob("*.log")]
    assert sum("the node ends: the run is complete" in log for log in logs) == 1, "the plant"
    assert sum("the node ends: it was asked to end" in log for log in logs) == len(NODES) - 1
    assert_flown(read_run(recorded_bag), simulate(load([PAPER]), 2.0))


long = pytest.mark.long
# Overlays, what is changed, and for how many seconds it flies.
HARDWARE = {
    # As test_what_visitors_do_is_on_record_and_is_flown_again has it in every run, by its replay.
    "thrusters": ("thrusters", {"thrusters.fuel": 5e-5}, 1.0),
    # In orbit the injector waits for the truth, which the plant then sends; as
    # test_the_allocators_node_gives_the_bits_of_the_loop has it in every run.
    "rods": (
        "wheels orbit unloading",
        {
            "wheels.initial_speed": [300.0, 0.0, 0.0, 0.0],
            "magnetorquers.period": 0.5,
            "magnetorquers.magnetometer_noise": 1e-7,
        },
        1.0,
    ),
    # As test_campaign_record has it in every run.
    "smallsat": ("sensors_smallsat", {"rate": 100.0}, 2.0),
    "cubesat": ("sensors_cubesat", {"rate": 50.0, "initial_fix": False}, 4.0),
    "flagship": ("sensors_flagship", {"rate": 1000.0}, 1.0),
}


@long
@pytest.mark.parametrize("name", HARDWARE)
def test_nodes_and_loop_agree_with_hardware_too(name, tmp_path, start_process):
    overlays, given, seconds = HARDWARE[name]
    files = [*(PAPER.with_name(f"{each}.yaml") for each in overlays.split()), tmp_path / "own.yaml"]
    files[-1].write_text(yaml.safe_dump({"/**": {"ros__parameters": given}}))
    options = [word for file in files for word in ("--config", str(file))]
    run = Run(start_process, tmp_path / "bag", "--duration", f"{seconds:g}", *options)
    assert run.ends() in (0, 1), run.err  # too short to settle
    record = read_run(run.bag)
    assert_flown(record, simulate(load([PAPER, *files]), seconds))
    unknown = np.count_nonzero(~record["attitude"].any(axis=1))
    assert unknown == (0 if given.get("initial_fix", True) else round(0.2 * given["rate"]))
    if name == "thrusters":
        assert "[ERROR]" in run.err
        assert run.err.count("the fuel is used up") == 1
    if name == "rods":  # each dipole is held for a period
        assert len(np.unique(record["magnetorquer_dipole"], axis=0)) == 3


BAD = {
    "infeasible": (CONTROLLER, "rate_envelope: {exponential_terminal: 1.0e-6}", "rate_envelope"),
    "unknown name": (INJECTOR, "enviroment: true", "environment"),
    "missing file": (PLANT, None, "nowhere.yaml"),
}


@pytest.fixture
def node(tmp_path, monkeypatch, capfd):
    """A function that runs a node in this process, and gives its exit code and what it said."""
    monkeypatch.chdir(tmp_path)

    def run(name, *arguments):
        with node_here(name, *arguments) as (run_node, _):
            code = run_node()
        gc.collect()  # what is left of a node that would not begin
        return code, capfd.readouterr().err

    return run


@pytest.mark.parametrize("case", BAD)
def test_bad_configuration_is_refused_by_commands_and_node(case, node, tmp_path, capfd):
    name, text, told = BAD[case]
    path = tmp_path / "nowhere.yaml"
    if text is not None:
        path = tmp_path / "bad.yaml"
        path.write_text(f"/**/{name}:\n  ros__parameters:\n    {text}\n")
    files = ["--params-file", str(PAPER), "--params-file", str(path)]
    refusals = [node(name, "--ros-args", *files)]
    for command in ("run", "simulate", "check"):
        code = main([command, "--config", str(PAPER), "--config", str(path)])
        refusals.append((code, capfd.readouterr().err))
        assert refusals[-1][1].startswith("error: ")
        assert refusals[-1][1].count("\n") == 1
    for code, err in refusals:
        assert code == 2, err
        assert told in err
        assert "Traceback" not in err
    assert not (tmp_path / "bags").exists()


WRONG = {
    "forgotten --ros-args": (["-p", "storage:=mcap"], "argument -p; allowed: --help, or arg"),
    "file that is not there": (["--ros-args", "--params-file", "nowhere.yaml"], "nowhere.yaml"),
    "unknown name": (["--ros-args", "-p", "speed:=1.0"], "no parameter speed"),
    "wrong choice": (["--ros-args", "-p", "storage:=tape"], "one of mcap, sqlite3"),
    "no namespace": (["--ros-args", "-p", "namespaces:=[]"], "allowed: at least one"),
    "impossible namespace": (["--ros-args", "-p", "namespaces:=[a-b]"], "a-b"),
    "two runs on one topic": (
        ["--ros-args", "-p", "namespaces:=['', truth]"],
        "/truth/attitude would be a topic of 2 runs; allowed: namespaces that share no topic",
    ),
    "facts of a wrong type": (
        ["--ros-args", "-p", """run_info:='{"samples": {"plant": 3}}'"""],
        "run_info: samples = {'plant': 3}; allowed: an object with the list of topics of each node",
    ),
    "half a remapping": (["--ros-args", "-r", "half"], "half"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_node_tells_wrong_arguments_and_leaves_nothing(case, node, tmp_path):
    arguments, told = WRONG[case]
    code, err = node(RECORDER, *arguments)
    assert code == 2, err
    assert told in err.splitlines()[-1]
    assert "Traceback" not in err
    assert list(tmp_path.glob("bags/*")) == []


def test_an_estimator_that_does_not_say_when_its_fixes_come_does_not_begin(node, monkeypatch):
    monkeypatch.setitem(ESTIMATORS.components, "mekf", replace(mekf.COMPONENT, parameters=()))
    noise = ("star_tracker.cross_noise:=1.0e-5", "star_tracker.boresight_noise:=1.0e-5")
    options = [word for each in ("estimator:=mekf", *noise) for word in ("-p", each)]
    code, err = node(ESTIMATOR, "--ros-args", *options)
    assert code == 2, err
    assert "mekf reads star_fix, which comes late, and has no parameter star_tracker.rate" in err


def test_a_recorder_overwrites_no_bag(node, tmp_path):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "mine").write_text("keep")
    code, err = node(RECORDER, "--ros-args", "-p", f"bag:={tmp_path / 'bag'}")
    assert code == 2
    assert "exists" in err
    assert [path.name for path in (tmp_path / "bag").iterdir()] == ["mine"]


@long
def test_latency_is_that_of_a_run_with_its_bag_and_verdict(tmp_path, start_process):
    bag = tmp_path / "bag"
    options = ["--config", str(PAPER), "--rate", "50", "--duration", "5", "--bag", str(bag)]
    process = start_process([*COMMAND, "latency", *options])
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode in (0, 3), err  # a busy machine may lose some
    assert out.startswith("states ")
    assert "deadline 20 ms" in out
    assert "state to torque: p50" in out
    assert out.splitlines()[-1] == f"bag: {bag}"
    assert read_run(bag).parameters[PLANT]["rate"] == 50.0
