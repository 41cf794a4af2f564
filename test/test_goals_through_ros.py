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

"""Goals to a running stack: what acted is in the bag with its stamp, and the bag flies it again."""

import signal
from pathlib import Path

import numpy as np
import pytest
from conftest import StartProcess
from process_helpers import LOOP, Node, Run, pace

from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line.main import main
from ppc_attitude.contract.topics import CLOCK_TOPIC, PLANT, RECORDER, REFERENCE

pytestmark = pytest.mark.ros
GOALS = "/**/reference_generator:\n  ros__parameters:\n    mode: goal\n"


@pytest.mark.parametrize("mode", ["lock-step", pytest.param("free", marks=pytest.mark.long)])
def test_goal_in_flight_is_on_record_from_when_it_acted_and_is_flown_again(
    mode: str,
    tmp_path: Path,
    start_process: StartProcess,
    capsys: pytest.CaptureFixture[str],
) -> None:
    free = mode == "free"
    run = Run(
        start_process,
        tmp_path / "bag",
        *("--duration", "1000"),
        *(["--realtime"] if free else []),
        overlay=GOALS if free else GOALS + pace(4.0),
    )
    run.reaches(1.0)
    assert main(["goto", "--euler", "0", "0", "30"]) == 0
    assert "order 1 is followed: inertial frame" in capsys.readouterr().out
    run.reaches(run.time + 3.0)
    run.send(signal.SIGINT)
    run.ends()

    record = read_run(run.bag)
    changed = {each.name: each for each in record.changes if each.node == REFERENCE}
    times = changed["goals.times"]
    assert times.value == [times.stamp_ns * 1e-9]
    assert changed["goals.frames"].value == ["inertial"]
    began = int(np.searchsorted(record.stamps_ns, times.stamp_ns))
    assert record.stamps_ns[began] == times.stamp_ns
    moving = np.linalg.norm(record["reference_angular_acceleration"], axis=1) > 0.0
    assert int(np.flatnonzero(moving)[0]) == began + 1
    assert main(["replay", str(run.bag)]) == 0


@pytest.mark.long
def test_a_goal_for_one_craft_moves_no_other(
    tmp_path: Path, start_process: StartProcess, capsys: pytest.CaptureFixture[str]
) -> None:
    homes = ("/chief", "/deputy")
    both = f"/bag_recorder:\n  ros__parameters:\n    namespaces: [{', '.join(homes)}]\n"
    overlay = tmp_path / "two.yaml"
    overlay.write_text(GOALS + pace(2.0) + both)
    bag = tmp_path / "bag"
    recorder = Node(start_process, tmp_path, RECORDER, f"bag:={bag}", file=overlay)
    recorder.says("recording to")
    crafts = [
        Node(
            start_process,
            tmp_path,
            name,
            *(("lockstep:=true",) if name == PLANT else ()),
            mark=home.strip("/"),
            file=overlay,
            remap=(f"__ns:={home}", f"{CLOCK_TOPIC.name}:={CLOCK_TOPIC.name.strip('/')}"),
        )
        for home in homes
        for name in LOOP
    ]
    for node in crafts:
        node.says("ready")
    assert main(["goto", "--euler", "0", "0", "30", "--namespace", homes[0]]) == 0
    assert "order 1 is followed" in capsys.readouterr().out
    for node in (*crafts, recorder):
        node.send(signal.SIGINT)
    assert [node.ends() for node in (*crafts, recorder)] == [0] * (len(crafts) + 1)

    chief, deputy = (read_run(bag, namespace=home) for home in homes)
    assert "goals.times" in {each.name for each in chief.changes}
    assert not deputy.changes
    moving = [np.any(run["reference_angular_acceleration"]) for run in (chief, deputy)]
    assert moving == [True, False]
    assert [main(["replay", str(bag), "--namespace", home]) for home in homes] == [0, 0]
