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

"""What stirs a loop over DDS: disabled, reset, and bad messages on every input of every node."""

import math
import signal
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import StartProcess
from peer import Peer, last_torque, peer
from process_helpers import LOOP, PAPER, Process, plans, until
from std_srvs.srv import SetBool, Trigger

from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    APPLIED_TORQUE,
    ATTITUDE,
    CONTROLLER,
    DISTURBANCE,
    INJECT,
    INJECTOR,
    MSGTYPES,
    PLANT,
    REFERENCE,
    REFERENCE_ACCELERATION,
    REFERENCE_ATTITUDE,
    REFERENCE_RATE,
    TORQUE_COMMAND,
    Topic,
)
from ppc_attitude.science.component import QUATERNION
from ppc_attitude.science.stamps import NANOSECONDS

pytestmark = pytest.mark.ros

# Input to the nodes that read it.
READERS = {
    ATTITUDE: (REFERENCE, CONTROLLER, INJECTOR),
    ANGULAR_VELOCITY: (CONTROLLER,),
    REFERENCE_ATTITUDE: (CONTROLLER,),
    REFERENCE_RATE: (CONTROLLER,),
    REFERENCE_ACCELERATION: (CONTROLLER,),
    TORQUE_COMMAND: (PLANT,),
    DISTURBANCE: (PLANT,),
    INJECT: (INJECTOR,),
}
MAX_TORQUE = 0.05  # [N·m] per axis
FLOOD, LASTS = 10_000, 0.05  # [Hz], [s]
# The nodes are copies of one process, as those of a run, and say all that they have to say.
NODES = """
import os, signal, sys, threading
from ppc_attitude.command_line import stack
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.simulation.closed_loop import warm_up
from ppc_attitude.simulation.scenario import load
file, mode, *names = sys.argv[1:]
scenario = load([file]).with_values(PLANT, lockstep=mode == "lockstep", real_time_factor=1.0)
warm_up(scenario)
stop = threading.Event()
signal.signal(signal.SIGINT, lambda number, frame: stop.set())
say = lambda line: print(line, file=sys.stderr, flush=True)
nodes = stack.Stack(scenario, lambda simulated: None, names, os.environ, say)
nodes.start()
nodes.wait(stop)
nodes.stop()
"""
FUTURE = 2_000_000_000 * NANOSECONDS  # no run has come so far


def good(topic: Topic) -> tuple[float, ...]:
    return (0.0, 0.0, 0.0, 1.0) if topic.msgtype == MSGTYPES[QUATERNION] else (0.01, -0.02, 0.03)


def impossible(topic: Topic) -> Iterator[bytes]:
    """Messages that no node may use, whenever they come."""
    codec, numbers = Codec(topic), good(topic)
    stamp = NANOSECONDS
    for number in (math.nan, math.inf, -math.inf, 1e308):
        for place in range(topic.width):
            yield codec.encode(stamp, (*numbers[:place], number, *numbers[place + 1 :]))
    if topic.msgtype == MSGTYPES[QUATERNION]:
        # An attitude of zeros says that there is no estimate yet.
        for length in (*([] if topic is ATTITUDE else [0.0]), 0.998, 1.002, 1e-300, 7.0):
            yield codec.encode(stamp, (0.0, length, 0.0, 0.0))
    for frame in ("moon", "", "x" * 300):
        if topic is not INJECT or frame:
            yield Codec(replace(topic, frame_id=frame)).encode(stamp, numbers)
    for negative in (-1, -NANOSECONDS, -(2**31) * NANOSECONDS):
        yield codec.encode(negative, numbers)
    if topic is INJECT:
        yield codec.encode(FUTURE, numbers)  # of the wall clock: such a torque would never act
    whole = codec.encode(stamp, numbers)
    yield whole[:20]
    yield whole[: len(whole) - 8]
    yield bytes(4)


def refused(stack: Peer, node: str, topic: Topic) -> int:
    return int(stack.health.get(node, {}).get(f"refused {topic.name}", 0))


def expect_refusals(stack: Peer, messages: dict[Topic, list[bytes]]) -> None:
    """Send messages; every reader counts every one."""
    ways = [(node, topic) for topic in messages for node in READERS[topic]]
    before = {way: refused(stack, *way) for way in ways}
    for topic, each in messages.items():
        for data in each:
            stack.send(topic, data)
    for (node, topic), count in before.items():
        expected = count + len(messages[topic])
        stack.until(
            lambda node=node, topic=topic, expected=expected: (
                refused(stack, node, topic) >= expected
            ),
            f"{len(messages[topic])} refusals of {topic.name} by {node}",
        )


def expect_finite(stack: Peer) -> None:
    """All that the nodes have sent so far is finite and within the limits."""
    for name, samples in stack.heard.items():
        for sample in samples:
            assert all(map(math.isfinite, sample.values)), (name, sample)
    for sample in stack.heard[ATTITUDE.name]:
        assert math.hypot(*sample.values) == pytest.approx(1.0, abs=1e-9)
    for topic in (TORQUE_COMMAND, APPLIED_TORQUE):
        for sample in stack.heard[topic.name]:
            assert max(map(abs, sample.values)) <= MAX_TORQUE, (topic.name, sample)


def flood(stack: Peer, topic: Topic) -> None:
    """Send bad messages at 10 kHz."""
    bad = Codec(topic).encode(0, (math.nan,) * topic.width)
    begin = time.monotonic()
    for number in range(int(LASTS * FLOOD)):
        while time.monotonic() < begin + number / FLOOD:
            stack.spin()
        stack.send(topic, bad)


@pytest.fixture(params=["lockstep", pytest.param("free-running", marks=pytest.mark.long)])
def nodes(
    request: pytest.FixtureRequest, start_process: StartProcess, tmp_path: Path
) -> Iterator[Process]:
    """Plant, reference, controller and injector at 100 steps a second; they must end well."""
    began = time.monotonic()
    command = [sys.executable, "-c", NODES, str(PAPER), request.param, *LOOP]
    started = Process(start_process, tmp_path, "nodes", command)
    yield started
    lasted = time.monotonic() - began
    started.send(signal.SIGINT)
    assert started.ends() == 0, started.err
    assert "Traceback" not in started.err
    for node in LOOP:
        lines = [line for line in started.err.splitlines() if f"[{node}]: " in line]
        assert sum("ends: it was asked to end" in line for line in lines) == 1, lines
        for topic in READERS:
            said = sum(f"refused {topic.name}: " in line for line in lines)
            assert said <= lasted + 1.0, "more than once a second"


def send_states_of_other_times(stack: Peer) -> None:
    """States that could be true, alone or with their rate, copied or not: they may only delay."""
    for ahead in (None, 5 * NANOSECONDS, FUTURE):
        for topics in ((ATTITUDE,), (ANGULAR_VELOCITY,), (ATTITUDE, ANGULAR_VELOCITY)):
            now = stack.heard[APPLIED_TORQUE.name][-1].stamp_ns
            stamp = 0 if ahead is None else min(now + ahead, FUTURE)
            for topic in topics:
                for _ in range(1 if ahead else 5):
                    stack.send(topic, Codec(topic).encode(stamp, good(topic)))
            stack.goes_on(0.1)


def disable(stack: Peer, nodes: Process) -> None:
    """No torque while the controller is disabled, and a new plan afterwards."""
    assert stack.call(SetBool, f"/{CONTROLLER}/enable", SetBool.Request(data=False)).success
    stack.until(lambda: last_torque(stack) == 0.0, "zero torque")
    stack.goes_on(0.2)
    assert last_torque(stack) == 0.0
    stack.hears(CONTROLLER, "disabled: zero torque")
    disabled_until = stack.time(APPLIED_TORQUE)
    assert stack.call(SetBool, f"/{CONTROLLER}/enable", SetBool.Request(data=True)).success
    stack.until(lambda: last_torque(stack) > 0.0, "torque")
    until(lambda: plans(nodes)[-1][0] >= disabled_until, "a new plan")


def reset(stack: Peer, nodes: Process) -> None:
    """Time begins again, for every node."""
    before, planned = stack.time(APPLIED_TORQUE), len(plans(nodes))
    assert stack.call(Trigger, f"/{PLANT}/reset", Trigger.Request()).success
    stack.until(lambda: 0.0 <= stack.time(APPLIED_TORQUE) < before, "time to go back")
    stack.goes_on(0.2)
    nodes.says("time has begun again at 0.000 s: re-armed")
    until(lambda: len(plans(nodes)) > planned, "a plan of the new time")
    (_, first), *_, (start, error) = plans(nodes)
    assert start == 0.0
    assert error == pytest.approx(first, abs=1.0)  # at the start the controller may be late


def test_a_loop_is_disabled_and_reset_and_bad_messages_change_nothing(nodes: Process) -> None:
    with peer(*READERS) as stack:
        stack.goes_on(0.2)
        disable(stack, nodes)
        reset(stack, nodes)
        for node in (REFERENCE, CONTROLLER, INJECTOR):
            stack.until(lambda node=node: node in stack.health, f"{node} to tell its health")
            assert not [key for key in stack.health[node] if key.startswith("refused")], node
        for topic, readers in READERS.items():
            stack.matched(topic, readers)
        expect_refusals(stack, {topic: list(impossible(topic)) for topic in READERS})
        stack.goes_on(0.2)
        # Out of order, and of an instant to come.
        expect_refusals(
            stack,
            {
                topic: [Codec(topic).encode(stamp, good(topic)) for stamp in (1, FUTURE)]
                for topic in (TORQUE_COMMAND, DISTURBANCE)
            },
        )
        send_states_of_other_times(stack)
        for topic in READERS:
            flood(stack, topic)
        stack.goes_on(0.2)
        expect_finite(stack)
