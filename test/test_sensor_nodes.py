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

"""Six processes in lock-step with sensors and filter give the bits of the loop in process."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from bag_helpers import assert_same
from conftest import StartProcess
from estimation_helpers import ROOT
from peer import peer
from process_helpers import LOOP, PAPER, PATIENCE, Node, Run, pace, pause

from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line.parameter_file import parameter_file
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import CONTROLLER, ESTIMATOR, PLANT, TORQUE_COMMAND
from ppc_attitude.simulation.closed_loop import simulate, warm_up
from ppc_attitude.simulation.scenario import load

SMALLSAT = ROOT / "config" / "sensors_smallsat.yaml"

pytestmark = [pytest.mark.ros, pytest.mark.long]


@pytest.mark.parametrize(
    ("suite", "rate", "initial_fix", "duration"),
    [
        ("smallsat", 100.0, True, 2.0),  # as test_campaign_record has it in every run
        ("cubesat", 50.0, False, 4.0),
        ("flagship", 1000.0, True, 1.0),
    ],
)
def test_nodes_and_loop_agree_to_the_last_bit(
    suite: str, rate: float, initial_fix: bool, duration: float, tmp_path: Path, ros_domain: int
) -> None:
    overlay = tmp_path / "overlay.yaml"
    given = {"rate": rate, "initial_fix": initial_fix}
    overlay.write_text(yaml.safe_dump({"/**": {"ros__parameters": given}}))
    files = [ROOT / "config" / f"{name}.yaml" for name in ("paper", f"sensors_{suite}")]
    options = [option for path in (*files, overlay) for option in ("--config", str(path))]
    bag = tmp_path / "bag"
    options += ["--duration", f"{duration:g}", "--bag", str(bag)]
    subprocess.run(
        [sys.executable, "-m", "ppc_attitude.command_line.main", "run", *options],
        capture_output=True,
        timeout=2.0 * PATIENCE,
        check=False,  # so short a run meets no deadline
    )
    recorded = read_run(bag)
    expected = simulate(load([*files, overlay]), duration)
    expect_same(recorded, expected)
    unknown = ~expected["attitude"].any(axis=1)
    assert unknown.sum() == (0 if initial_fix else round(0.2 * rate))


def expect_same(recorded: RunRecord, expected: RunRecord) -> None:
    assert (recorded.warnings, recorded.missing) == ((), {})
    assert_same(recorded, expected)


@pytest.mark.parametrize("name", [ESTIMATOR, CONTROLLER])
def test_states_that_are_repeated_change_no_bit(
    name: str, tmp_path: Path, start_process: StartProcess
) -> None:
    """The plant repeats what a paused node does not answer, sensors included."""
    overlay = pace(2.0) + SMALLSAT.read_text()
    run = Run(start_process, tmp_path / "bag", "--duration", "6", overlay=overlay)
    run.reaches(1.0)
    pid = run.nodes()[name]
    pause(pid)
    time.sleep(2.0)  # the fault lasts; nothing is waited for
    os.kill(pid, signal.SIGCONT)
    assert run.ends() == 0, run.err  # too short to settle
    scenario = load([PAPER, SMALLSAT])
    expect_same(read_run(run.bag), simulate(scenario, 6.0))


def test_an_estimator_that_is_started_again_begins_with_the_next_fix(
    tmp_path: Path, start_process: StartProcess
) -> None:
    pace_of_the_clock = {PLANT: {"lockstep": True, "real_time_factor": 1.0}}
    scenario = load([PAPER, SMALLSAT], pace_of_the_clock)
    file = tmp_path / "parameters.yaml"
    file.write_text(parameter_file(scenario))
    warm_up(scenario)
    nodes = {name: Node(start_process, tmp_path, name, file=file) for name in (ESTIMATOR, *LOOP)}
    with peer() as stack:
        stack.goes_on(1.0)
        nodes[ESTIMATOR].send(signal.SIGKILL)
        assert nodes[ESTIMATOR].ends() == -signal.SIGKILL
        stack.hears(PLANT, "waiting at t")
        ended_at = stack.time(TORQUE_COMMAND)
        nodes[ESTIMATOR] = Node(start_process, tmp_path, ESTIMATOR, mark="_again", file=file)
        stack.goes_on(1.0)
        stack.hears(ESTIMATOR, "tracking")
        told = [x.values for x in stack.heard[TORQUE_COMMAND.name] if x.stamp_ns * 1e-9 > ended_at]
        acts = np.array(told).any(axis=1)
        begins = int(acts.argmax())
        # Without estimate zero torque; the next slot arrives within 0.1 s, or the one after it.
        assert 0 < begins <= 21
        assert acts[begins:].all()
        for node in nodes.values():
            node.send(signal.SIGINT)
        for node in nodes.values():
            assert node.ends() == 0, node.err
            assert "Traceback" not in node.err
