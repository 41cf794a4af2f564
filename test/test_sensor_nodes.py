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

"""Sensors and filter as nodes: states that are repeated, an estimator that is started again."""

import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from bag_helpers import assert_flown
from conftest import StartProcess
from craft_helpers import configs
from peer import peer
from process_helpers import LOOP, PAPER, Node, Run, end_all, pace, pause

from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line.parameter_file import parameter_file
from ppc_attitude.contract.topics import ESTIMATOR, PLANT, RECORDER, TORQUE_COMMAND
from ppc_attitude.simulation.closed_loop import simulate, warm_up
from ppc_attitude.simulation.scenario import load

(SMALLSAT,) = configs("sensors_smallsat")

pytestmark = [pytest.mark.ros, pytest.mark.long]


@pytest.mark.parametrize("name", [ESTIMATOR, RECORDER, *LOOP])
def test_a_pause_costs_lockstep_nothing_but_time(
    name: str, tmp_path: Path, start_process: StartProcess
) -> None:
    """The plant repeats what a paused node does not answer, sensors included: no bit changes."""
    options = ("--duration", "6", "--config", str(SMALLSAT))
    run = Run(start_process, tmp_path / "bag", *options, overlay=pace(2.0))
    run.reaches(1.0)
    pid = run.nodes()[name]
    pause(pid)
    time.sleep(3.0)  # the fault lasts; nothing is waited for
    os.kill(pid, signal.SIGCONT)
    assert run.ends() == 0, run.err  # too short to settle
    scenario = load([PAPER, SMALLSAT])
    assert_flown(read_run(run.bag), simulate(scenario, 6.0))


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
        end_all(nodes.values())
