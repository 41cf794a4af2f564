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

"""What the recorder takes of publishers that offer less than the nodes of a run do."""

from functools import partial
from pathlib import Path

import pytest
import rclpy
from peer import Beside
from rclpy.qos import QoSProfile, ReliabilityPolicy

from ppc_attitude.bags.reader import read_run
from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.topics import ATTITUDE, CONTROLLER
from ppc_attitude.nodes.bag_recorder import BagRecorder
from ppc_attitude.nodes.messages import message_class
from ppc_attitude.science.stamps import stamp_of

UNIT = (0.0, 0.0, 0.0, 1.0)


@pytest.mark.ros
def test_what_one_run_sends_at_best_effort_is_recorded_as_of_that_run(tmp_path: Path) -> None:
    """Every full name begins with the home of the run that has no namespace."""
    bag = tmp_path / "bag"
    rclpy.init(args=["--ros-args", "-p", f"bag:={bag}", "-p", "namespaces:=['', craft]"])
    beside = Beside(BagRecorder(), ATTITUDE)
    weak = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
    theirs = beside.peer.create_publisher(
        message_class(ATTITUDE.msgtype), f"/craft/{ATTITUDE.name}", weak
    )
    beside.meet()
    step = 0

    def taken() -> bool:
        nonlocal step
        beside.send(ATTITUDE, stamp_of(step, 100.0), UNIT)
        theirs.publish(Codec(ATTITUDE).encode(stamp_of(step, 100.0), UNIT))
        step += 1
        beside.node.wake()
        return beside.node._recordings["/craft"].now >= 0

    beside.until(taken)
    beside.close()
    rclpy.try_shutdown()
    assert read_run(bag, namespace="/craft").stamps_ns.size > 0


@pytest.mark.ros
def test_a_node_that_is_started_again_is_asked_again(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The first may have had other parameters, or have ended before it answered."""
    rclpy.init(args=["--ros-args", "-p", f"bag:={tmp_path / 'bag'}"])
    beside = Beside(BagRecorder())

    def is_on_record(k: float) -> bool:
        beside.node.wake()
        parameters = beside.node._run_info.get("parameters", {})
        return bool(parameters.get(f"/{CONTROLLER}", {}).get("k") == k)

    for k in (1.0, 2.0):
        controller = rclpy.create_node(CONTROLLER)
        controller.declare_parameter("k", k)
        beside.executor.add_node(controller)
        beside.until(partial(is_on_record, k))
        beside.executor.remove_node(controller)
        controller.destroy_node()
    beside.close()
    rclpy.try_shutdown()
    assert f"/{CONTROLLER} was started again with other parameters" in capfd.readouterr().err
