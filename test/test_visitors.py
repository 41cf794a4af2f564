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

"""A run with visitors: what they did is in its bag with its stamp, and the bag flies it again."""

import re
import signal
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from itertools import chain, count, repeat
from pathlib import Path
from threading import Event, Thread
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rclpy
from conftest import StartProcess
from peer import node_apart
from process_helpers import LOOP, PAPER, PATIENCE, Node, Run, end_all, pace, until
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line.commands import watch
from ppc_attitude.command_line.main import main
from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import (
    APPLIED_TORQUE,
    ATTITUDE,
    CLOCK_TOPIC,
    PLANT,
    RECORDER,
    REFERENCE,
    REFERENCE_ACCELERATION,
    TORQUE_COMMAND,
    Topic,
)
from ppc_attitude.nodes import goto, visiting
from ppc_attitude.nodes.messages import message_class, publisher_of
from ppc_attitude.processes import exits
from ppc_attitude.science.stamps import stamp_of

pytestmark = pytest.mark.ros
long = pytest.mark.long
GOALS = "/**/reference_generator:\n  ros__parameters:\n    mode: goal\n"
# So that the thrusters, which no other quick test flies through nodes, come to their end.
LITTLE_FUEL = "/**:\n  ros__parameters: {thrusters.fuel: 5.0e-5}\n"
TORQUE = (0.3, -0.2, 0.1)  # [N·m]
Shown = pytest.CaptureFixture[str]


@pytest.fixture
def stranger() -> Iterator[rclpy.node.Node]:
    with node_apart("stranger") as node:
        yield node


@pytest.mark.parametrize("mode", ["lock-step", pytest.param("--realtime", marks=long)])
def test_what_visitors_do_is_on_record_and_is_flown_again(
    mode: str,
    stranger: rclpy.node.Node,
    tmp_path: Path,
    start_process: StartProcess,
    monkeypatch: pytest.MonkeyPatch,
    capfd: Shown,
) -> None:
    free, fuel = mode == "--realtime", tmp_path / "fuel.yaml"
    fuel.write_text(LITTLE_FUEL)
    weak = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    stranger.create_publisher(message_class(TORQUE_COMMAND.msgtype), TORQUE_COMMAND.name, weak)
    run = Run(
        start_process,
        tmp_path / "bag",
        *("--duration", "1000"),
        *(f"--config={file}" for file in (PAPER.with_name("thrusters.yaml"), fuel)),
        *([mode] if free else []),
        overlay=GOALS if free else GOALS + pace(0.5),
    )
    run.reaches(0.5)
    assert first_stamp(stranger) > 0.4  # [s] what is shown is rounded; history would begin at 0

    monkeypatch.setattr(goto, "publisher_of", losing_publisher_of)
    monkeypatch.setattr(visiting, "_AGAIN", 0.2)  # [s] meanwhile the run goes on
    assert main(["goto", "--euler", "0", "0", "30"]) == exits.DONE
    assert "order 1 is followed: inertial frame" in capfd.readouterr().out

    assert main(["inject", "99", "0", "0"]) == exits.BAD_INPUT
    allowed = "up to 10.0 N·m per axis (max_injected_torque)"
    told = f"error: torque = (99.0, 0.0, 0.0) N·m; allowed: {allowed}\n"
    assert capfd.readouterr() == ("", told)
    at = round(run.time + 1.0, 1)
    hit = ["inject", *map(str, TORQUE), "--duration", "0.25", "--at", str(at)]
    assert main(hit) == exits.DONE
    found = re.search(r"acts from t = (\S+) s to (\S+) s", capfd.readouterr().out)
    assert found
    start, end = map(float, found.groups())
    assert start >= at  # later only where this process came too late
    assert end == pytest.approx(start + 0.25, abs=1e-6)

    monkeypatch.setattr(watch, "_SETTLE", PATIENCE)  # all there is to see will come
    monkeypatch.setenv("COLUMNS", "80")  # whatever the terminal
    assert main(["watch", "--once", "--timeout", str(PATIENCE)]) == exits.DONE
    shown = capfd.readouterr().out
    assert "attitude error" in shown.splitlines()[0]
    for quantity in ("attitude z", "rate [°/s] z"):
        (line,) = (each for each in shown.splitlines() if quantity in each)
        assert "%" in line

    run.reaches(end + 0.2)
    run.send(signal.SIGINT)
    assert run.ends() == exits.BROKEN
    assert "[ERROR]" in run.err
    assert run.err.count("the fuel is used up") == 1
    record = read_run(run.bag)
    assert free or record.missing_messages == 0  # the idle stranger costs nothing
    expect_goal(record)
    expect_hit(record, start)
    assert main(["replay", str(run.bag)]) == exits.DONE


def losing_publisher_of(node: rclpy.node.Node, topic: Topic) -> Publisher:
    """Make a publisher that loses its first message, as to a reader that does not know it yet."""
    publisher = publisher_of(node, topic)
    ways = chain([lambda message: None], repeat(publisher.publish))
    publisher.publish = lambda message: next(ways)(message)
    return publisher


def first_stamp(node: rclpy.node.Node) -> float:
    """Stamp [s] of the first state that a new subscriber gets."""
    stamp = hears(node, ATTITUDE.name, ATTITUDE, lambda message: True).header.stamp
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def hears(node: rclpy.node.Node, name: str, topic: Topic, wanted: Callable[[Any], bool]) -> Any:
    """Wait for such a message; return the first."""
    late = node.create_subscription(message_class(topic.msgtype), name, lambda message: None, 10)
    found: list[Any] = []

    def heard() -> bool:
        with late.handle:
            while not found and (taken := late.handle.take_message(late.msg_type, False)):
                found.extend(each for each in taken[:1] if wanted(each))
        return bool(found)

    until(heard, f"{name} as wanted")
    node.destroy_subscription(late)
    return found[0]


def expect_goal(record: RunRecord) -> None:
    """The goal acted, from the instant on that is told.

    Who waits for the processor hears the answer late, and orders again what has acted.
    """
    changed = {each.name: each for each in reversed(record.changes) if each.node == REFERENCE}
    times = changed["goals.times"]  # of the first order
    assert times.value == [times.stamp_ns / 1e9]
    assert "goals.frames" not in changed  # it was inertial before
    began = int(np.searchsorted(record.stamps_ns, times.stamp_ns))
    assert record.stamps_ns[began] == times.stamp_ns
    moving = np.linalg.norm(record["reference_angular_acceleration"], axis=1) > 0.0
    assert int(np.flatnonzero(moving)[0]) == began + 1


def expect_hit(record: RunRecord, start: float) -> None:
    """One hit acted, for its duration; the bag alone tells it."""
    (hit,) = Verdict(record).metrics.disturbances
    assert hit.start_s == pytest.approx(start, abs=1e-6)
    assert hit.duration_s == pytest.approx(0.25, abs=1e-9)
    assert hit.torque == pytest.approx(TORQUE, abs=1e-4)
    assert np.abs(record["disturbance_torque"]).max() < 0.31


def test_nobody_to_visit_is_said(monkeypatch: pytest.MonkeyPatch, capfd: Shown) -> None:
    monkeypatch.setattr(visiting, "_PATIENCE", 0.5)
    assert main(["inject", "0.1", "0.1", "0.1"]) == exits.BROKEN
    assert "no node offers the service /disturbance_injector/inject" in capfd.readouterr().err
    assert main(["goto", "--euler", "0", "0", "30"]) == exits.BROKEN
    assert "no node listens on /goal_pose" in capfd.readouterr().err


def test_states_that_nobody_answers_have_no_latency(
    stranger: rclpy.node.Node, capfd: Shown
) -> None:
    publisher, codec, over = publisher_of(stranger, ATTITUDE), Codec(ATTITUDE), Event()

    def send() -> None:
        for step in count():
            publisher.publish(codec.encode(stamp_of(step, 100.0), (0.0, 0.0, 0.0, 1.0)))
            if over.wait(0.01):
                return

    sender = Thread(target=send)
    sender.start()
    try:
        assert main(["latency", "--live", "--duration", "0.5"]) == exits.BROKEN
    finally:
        over.set()
        sender.join()
    told = capfd.readouterr().err
    assert re.search(r"none of [1-9]\d* states was answered on torque_command", told)


def test_a_request_whose_answer_is_lost_is_sent_again_by_its_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sent: list[dict[str, Any]] = []

    def call_async(request: Any) -> Any:
        sent.append({each.name: each.value for each in request.parameters})
        answer = SimpleNamespace(successful=True, reason="acts")
        response = SimpleNamespace(result=answer)
        came = len(sent) >= 3
        return SimpleNamespace(done=lambda: came, result=lambda: response)

    client = SimpleNamespace(service_is_ready=lambda: True, call_async=call_async)
    node = SimpleNamespace(
        create_client=lambda *given: client, resolve_service_name=lambda name: f"/{name}"
    )
    monkeypatch.setattr(visiting, "visiting", lambda *given: nullcontext(node))
    monkeypatch.setattr(visiting, "_AGAIN", 0.0)
    monkeypatch.setattr(visiting, "listening", lambda node: nullcontext(lambda patience: None))
    assert [visiting.inject(TORQUE, 0.0, None, "") for _ in range(2)] == ["acts", "acts"]
    assert sent[0] == sent[1] == sent[2] != sent[3]


@long
def test_a_goal_for_one_craft_moves_no_other(
    stranger: rclpy.node.Node, tmp_path: Path, start_process: StartProcess, capfd: Shown
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
            "wait_for_recorder:=true",
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
    for home in homes:
        for name in LOOP:
            recorder.says(f"the parameters of {home}/{name} are on record")
    assert main(["goto", "--euler", "0", "0", "30", "--namespace", homes[0]]) == 0
    assert "order 1 is followed" in capfd.readouterr().out
    turning = f"{homes[0]}/{REFERENCE_ACCELERATION.name}"
    hears(stranger, turning, REFERENCE_ACCELERATION, lambda each: each.vector.z != 0.0)
    acts = f"{homes[1]}/{APPLIED_TORQUE.name}"  # of the other craft, which has time of its own
    hears(stranger, acts, APPLIED_TORQUE, lambda each: each.header.stamp.sec >= 1)
    end_all([*crafts, recorder])

    chief, deputy = (read_run(bag, namespace=home) for home in homes)
    assert "goals.times" in {each.name for each in chief.changes}
    assert not deputy.changes
    moving = [np.any(run["reference_angular_acceleration"]) for run in (chief, deputy)]
    assert moving == [True, False]
    assert [main(["replay", str(bag), "--namespace", home]) for home in homes] == [0, 0]
