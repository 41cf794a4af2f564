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

"""The recorder beside others: what they offer, what it asks them, and what they ask it."""

import gc
import json
import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from errno import ENOSPC
from pathlib import Path

import pytest
import rclpy
import yaml
from conftest import StartProcess
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Quaternion, QuaternionStamped
from peer import Beside, living, peer
from process_helpers import Node, end_all, node_here, until
from rcl_interfaces.srv import ListParameters
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.reader import read_run
from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.topics import (
    APPLIED_TORQUE,
    ATTITUDE,
    CONTROLLER,
    DIAGNOSTICS_TOPIC,
    PLANT,
    RECORDED_TOPIC,
    RECORDER,
    REFERENCE,
    REFERENCE_ATTITUDE,
)
from ppc_attitude.nodes import run_graph
from ppc_attitude.nodes.bag_recorder import BagRecorder
from ppc_attitude.nodes.messages import message_class, publisher_of, take_gathered
from ppc_attitude.nodes.reference_generator import ReferenceGenerator
from ppc_attitude.processes.exits import BROKEN, DONE
from ppc_attitude.science.stamps import NANOSECONDS, stamp_of

UNIT = (0.0, 0.0, 0.0, 1.0)
pytestmark = pytest.mark.ros


@contextmanager
def recorder_into(bag: Path, *parameters: str) -> Iterator[Beside]:
    """Give a recorder in this process, and a peer beside it that sends states."""
    with living(BagRecorder, f"bag:={bag}", *parameters) as node:
        beside = Beside(node, ATTITUDE, APPLIED_TORQUE)
        beside.meet()
        yield beside
        beside.close()


def answer(beside: Beside, node: rclpy.node.Node, capfd: pytest.CaptureFixture[str]) -> None:
    """Let a node live until the recorder says that it has its parameters."""
    said = ""

    def has_answered() -> bool:
        nonlocal said
        beside.node.wake()
        said += capfd.readouterr().err
        return f"/{node.get_name()} are on record" in said

    beside.executor.add_node(node)
    beside.until(has_answered)
    beside.executor.remove_node(node)
    node.destroy_node()


def test_what_one_run_sends_at_best_effort_is_recorded_as_of_that_run(tmp_path: Path) -> None:
    """Every full name begins with the home of the run that has no namespace."""
    bag, step = tmp_path / "bag", 0
    weak = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
    with recorder_into(bag, "namespaces:=['', craft]") as beside:
        theirs = beside.peer.create_publisher(
            message_class(ATTITUDE.msgtype), f"/craft/{ATTITUDE.name}", weak
        )

        def taken() -> bool:
            nonlocal step
            beside.send(ATTITUDE, stamp_of(step, 100.0), UNIT)
            theirs.publish(Codec(ATTITUDE).encode(stamp_of(step, 100.0), UNIT))
            step += 1
            beside.node.wake()
            return beside.node._recordings["/craft"].now >= 0

        beside.until(taken)
    assert read_run(bag, namespace="/craft").stamps_ns.size > 0


def test_a_torque_that_is_read_before_the_state_of_a_reset_makes_no_gap(tmp_path: Path) -> None:
    """A recorder that waits for the processor between two topics reads them so."""
    with recorder_into(tmp_path / "bag") as beside:
        node, zero = beside.node, (0.0, 0.0, 0.0)
        torques = node._ears[f"/{APPLIED_TORQUE.name}"].subscription
        recording = node._recordings[""]
        for _ in range(2):
            beside.send(ATTITUDE, 0, UNIT)
            beside.send(APPLIED_TORQUE, 0, zero)
            until(lambda: take_gathered(torques), "the torque")
            beside.send(ATTITUDE, stamp_of(1, 100.0), UNIT)
            until(lambda: node._take_gathered() or recording.now > 0, "the state")
        beside.send(APPLIED_TORQUE, stamp_of(1, 100.0), zero)
        until(lambda: take_gathered(torques), "the last torque")
        assert recording.gaps([]) == []


def test_a_time_that_goes_back_and_not_to_zero_is_told_at_the_end(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with recorder_into(tmp_path / "bag") as beside:
        for step in (*range(50, 60), *range(10, 14)):
            beside.send(ATTITUDE, stamp_of(step, 100.0), UNIT)
        beside.until(lambda: beside.node.wake() and beside.node._recordings[""].surplus())
        beside.node.drain(beside.executor)
    told = "4 messages of /attitude are not judged: their stamps are not later than an earlier one"
    assert told in capfd.readouterr().err
    assert read_run(tmp_path / "bag").stamps_ns.size == 4


def test_a_recorder_without_room_for_a_bag_was_configured_well(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def full(*_: object, **__: object) -> None:
        raise BagError("no room") from OSError(ENOSPC, os.strerror(ENOSPC))

    monkeypatch.setattr("ppc_attitude.nodes.bag_recorder.BagWriter", full)
    with node_here(RECORDER) as (main, _):
        assert main() == BROKEN
    gc.collect()  # what was made of the node


def test_a_recorder_ends_although_its_stack_runs_on(tmp_path: Path) -> None:
    """It waited for a silence that does not come."""
    bag, most = tmp_path / "bag", 3000
    steps = iter(range(most))
    with recorder_into(bag) as beside:

        def send() -> None:
            if (step := next(steps, None)) is not None:
                beside.send(ATTITUDE, stamp_of(step, 100.0), UNIT)

        beside.peer.create_timer(0.01, send)
        beside.node.drain(beside.executor)
        sent = next(steps)
    assert beside.node.exit_code == DONE
    assert 0 < read_run(bag).stamps_ns.size <= sent < most


def test_a_node_that_is_started_again_is_asked_again(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """What it has else than before is a change; before the run its latest start counts.

    It begins anew, which is told as that it is enabled: a controller may have been disabled. That
    is so from the first that it sends on, whenever it answers.
    """
    bag = tmp_path / "bag"
    with recorder_into(bag) as beside:
        for asked, k in enumerate((1.0, 2.0, 3.0, 3.0)):
            node = rclpy.create_node(REFERENCE)
            if k == 3.0:  # the run has begun
                sent = publisher_of(node, REFERENCE_ATTITUDE)
                beside.until(sent.get_subscription_count)
                for step in (10 * asked, 10 * asked + 1):
                    beside.send(ATTITUDE, stamp_of(step, 100.0), UNIT)
                    sent.publish(Codec(REFERENCE_ATTITUDE).encode(stamp_of(step, 100.0), UNIT))
            own = ("key", [b"\x01", b"\xff"])  # JSON knows no bytes
            node.declare_parameters("", [("k", k), own])
            answer(beside, node, capfd)
    record = read_run(bag)
    theirs = record.parameters[REFERENCE]
    assert (theirs["k"], theirs["key"]) == (2.0, [1, 255])
    told = {(change.stamp_ns, change.name, change.value) for change in record.changes}
    begun = {(stamp_of(step, 100.0), "enabled", True) for step in (20, 30)}
    assert told == {(stamp_of(20, 100.0), "k", 3.0), *begun}


def test_a_recorder_that_cannot_write_what_it_learns_ends_as_a_broken_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """It ended with a traceback, and later told gaps in what it went on to hear, as of the bag."""

    def refuse(*_: str) -> None:
        raise BagError("the disk is full")

    with recorder_into(tmp_path / "bag") as beside:
        monkeypatch.setattr(beside.node._writer, "set_custom_data", refuse)
        node = rclpy.create_node(REFERENCE)
        beside.executor.add_node(node)
        sent = publisher_of(node, REFERENCE_ATTITUDE)
        beside.until(sent.get_subscription_count)
        beside.send(ATTITUDE, 0, UNIT)
        beside.until(lambda: beside.node.wake() >= 0.0 and beside.node.failure)
        beside.send(ATTITUDE, stamp_of(1, 100.0), UNIT)
        recording = beside.node._recordings[""]
        until(lambda: beside.node._take_gathered() or recording.now > 0, "the next state")
        beside.node.close()
        assert (beside.node.failure, beside.node.exit_code) == ("the disk is full", BROKEN)
        node.destroy_node()
    assert "is incomplete" not in capfd.readouterr().err


@pytest.mark.parametrize(("speaks", "since"), [(True, 2), (False, 3)])
def test_a_node_that_answers_before_it_speaks_is_on_record_from_its_own_first_word_on(
    speaks: bool, since: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not from that of the one before; and if it says none, from after the last state on."""
    monkeypatch.setattr(run_graph, "_UNSEEN", 0.0)
    bag = tmp_path / "bag"
    with recorder_into(bag) as beside:
        recorder = beside.node

        def started(k: float) -> tuple[rclpy.node.Node, Publisher]:
            node = rclpy.create_node(REFERENCE)
            node.declare_parameter("k", k)
            beside.executor.add_node(node)
            sent = publisher_of(node, REFERENCE_ATTITUDE)
            beside.until(sent.get_subscription_count)
            return node, sent

        def send(second: int, *publishers: Publisher) -> None:
            for each in publishers:
                each.publish(Codec(REFERENCE_ATTITUDE).encode(second * NANOSECONDS, UNIT))
            beside.send(ATTITUDE, second * NANOSECONDS, UNIT)
            recording = recorder._recordings[""]
            beside.until(lambda: recorder.wake() and recording.now == second * NANOSECONDS)

        before, sent = started(1.0)
        send(0, sent)
        beside.until(lambda: recorder.wake() and "parameters" in recorder._run_info)
        beside.executor.remove_node(before)
        before.destroy_node()
        after, sent = started(2.0)
        send(1)
        beside.until(lambda: recorder.wake() and recorder._restarted)
        send(2, *[sent] * speaks)
        send(3)
        after.destroy_node()
    first, second = read_run(bag).changes
    assert (first.name, first.value, second.name) == ("k", 2.0, "enabled")
    # The last state was for the one before: a replay begins anew at no instant.
    assert first.stamp_ns == second.stamp_ns == since * NANOSECONDS + (not speaks)


def test_a_plant_that_is_started_again_has_its_own_parameters_from_the_first_state_on(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """With it time begins again, at another rate, before it has told its parameters."""
    bag = tmp_path / "bag"
    with recorder_into(bag) as beside:
        for rate in (100.0, 50.0):
            node = rclpy.create_node(PLANT)
            node.declare_parameters("", [("rate", rate), ("duration", 149.0 / rate)])
            states = publisher_of(node, ATTITUDE)
            beside.until(states.get_subscription_count)
            for step in range(150):
                states.publish(Codec(ATTITUDE).encode(stamp_of(step, rate), UNIT))
            answer(beside, node, capfd)
    record = read_run(bag)
    assert (record.parameters[PLANT]["rate"], record.changes) == (50.0, ())
    assert record.stamps_ns.tolist() == [stamp_of(step, 50.0) for step in range(150)]
    assert not any("duration" in warning for warning in record.warnings)


def test_a_recorder_that_was_told_the_law_knows_which_of_its_columns_never_came(
    tmp_path: Path,
) -> None:
    told = json.dumps({"samples": {CONTROLLER: ["control/attitude_error"]}})
    with recorder_into(tmp_path / "bag", f"run_info:='{told}'") as beside:
        for step in range(3):
            beside.send(ATTITUDE, stamp_of(step, 100.0), UNIT)
        beside.node.drain(beside.executor)
    assert "control/attitude_error never came" in beside.node.failure
    assert beside.node.exit_code == BROKEN


def test_a_plant_is_told_nothing_before_the_other_nodes_have_answered(tmp_path: Path) -> None:
    """What the plant itself sends when it leaves the first state cannot have come."""
    answer, heard = REFERENCE_ATTITUDE.name, list[Clock]()
    told = json.dumps({"samples": {PLANT: [APPLIED_TORQUE.name], REFERENCE: [answer]}})
    with recorder_into(tmp_path / "bag", f"run_info:='{told}'") as beside:
        recording = beside.node._recordings[""]
        beside.peer.create_subscription(Clock, RECORDED_TOPIC.name, heard.append, 1)
        answers = beside.peer.create_publisher(QuaternionStamped, answer, 1)
        for topic in (answer, RECORDED_TOPIC.name):
            beside.until(lambda topic=topic: beside.node.count_subscribers(topic))
        for begun in (1.0, -1.0):  # time begins again
            beside.send(ATTITUDE, 0, (0.0, 0.0, 0.0, begun))
            beside.until(lambda: beside.node.wake() and recording.missing([answer]))
            assert not heard
            answers.publish(QuaternionStamped(quaternion=Quaternion(w=begun)))
            beside.until(lambda: beside.node.wake() and heard)
            assert not recording.missing([answer])
            heard.clear()
            beside.send(ATTITUDE, stamp_of(1, 100.0), UNIT)
            beside.until(lambda: beside.node.wake() and recording.now > 0)


def test_a_recorder_listens_to_whoever_a_node_of_the_run_listens_to(tmp_path: Path) -> None:
    """A plant waited for it, and it knew nobody of that name: both waited for ever."""
    with recorder_into(tmp_path / "bag") as beside:
        plant, own = rclpy.create_node(PLANT), rclpy.create_node("own")
        plant.create_subscription(Clock, "motors/asked", lambda _: None, 1)
        sent = own.create_publisher(Clock, "motors/asked", 1)
        beside.until(lambda: beside.node.wake() > 0.0 and sent.get_subscription_count() == 2)
        for node in (plant, own):
            node.destroy_node()


def test_a_recorder_listens_to_both_of_two_nodes_by_one_name(tmp_path: Path) -> None:
    """It listened to one: the run stalled, and named neither."""
    topics = ["control/one", "control/other"]
    told = json.dumps({"samples": {CONTROLLER: topics}})
    with recorder_into(tmp_path / "bag", f"run_info:='{told}'") as beside:
        contexts, sent = [rclpy.Context() for _ in topics], list[Publisher]()
        for context, topic in zip(contexts, topics, strict=True):  # as if in processes of their own
            rclpy.init(context=context)
            node = rclpy.create_node(CONTROLLER, context=context)
            sent.append(node.create_publisher(QuaternionStamped, topic, 1))
        beside.until(
            lambda: beside.node.wake() > 0.0 and all(each.get_subscription_count() for each in sent)
        )
        for context in contexts:
            context.shutdown()


def test_who_waits_for_the_recorder_reports_that_and_nothing_else() -> None:
    said: list[DiagnosticStatus] = []
    with living(ReferenceGenerator, "wait_for_recorder:=true") as node:
        node.now = lambda: time.monotonic() + 100.0
        beside = Beside(node)
        beside.peer.create_subscription(
            DiagnosticArray, DIAGNOSTICS_TOPIC.name, lambda message: said.extend(message.status), 1
        )
        beside.until(lambda: node.await_recorder() > 0.0 and said)
        beside.close()
    assert said[0].level == DiagnosticStatus.STALE
    assert said[0].message.startswith(f"waiting for {RECORDER} to listen to /reference/")


def test_a_recorder_counts_the_messages_of_its_bag_however_it_took_them(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with recorder_into(bag := tmp_path / "bag") as beside:
        for step in range(3):
            beside.send(ATTITUDE, stamp_of(step, 100.0), UNIT)
        beside.node.drain(beside.executor)
    written = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    said = f"closed {bag}: {written['message_count']} messages, none missing of the topics that ev"
    assert said in capfd.readouterr().err  # nobody told it what the law sends besides


@pytest.mark.slow
def test_a_recorder_asks_and_answers_in_full_flow(
    tmp_path: Path, start_process: StartProcess
) -> None:
    """Also by simulated time, whose clock comes as often as the states."""
    with peer() as stack:
        quick = "rate:=300.0"  # as many messages as those of all nodes at the default rate
        plant = Node(start_process, tmp_path, PLANT, quick)
        stack.until(lambda: stack.time(ATTITUDE) > 0.5, "the flow")
        bag, sim = f"bag:={tmp_path / 'bag'}", "use_sim_time:=true"
        recorder = Node(start_process, tmp_path, RECORDER, bag, sim)
        recorder.says(f"the parameters of /{PLANT} are on record")
        listed = ListParameters.Request()
        told = stack.call(ListParameters, f"/{RECORDER}/list_parameters", listed)
        assert "storage" in told.result.names
        end_all([plant])
        recorder.send(signal.SIGINT)
        recorder.ends()
