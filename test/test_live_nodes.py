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

"""Nodes that live alone: any order, late, killed, restarted, reconfigured."""

import re
import signal
import time
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import StartProcess
from geometry_msgs.msg import WrenchStamped
from peer import Beside, Peer, last_torque, living, peer
from process_helpers import ENDLESS, LOCKSTEP, Node, Run, end_all, loop_nodes, pace, plans, until
from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import Parameter
from rosbags.highlevel import AnyReader
from std_srvs.srv import SetBool, Trigger
from test_health import INSTANT, UNIT

from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line.main import main
from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.topics import (
    APPLIED_TORQUE,
    ATTITUDE,
    CONTROLLER,
    INJECTOR,
    PLANT,
    REFERENCE,
    TORQUE_COMMAND,
    TRUE_ATTITUDE,
)
from ppc_attitude.nodes.disturbance_injector import DisturbanceInjector
from ppc_attitude.nodes.ppc_controller import PpcController
from ppc_attitude.nodes.reference_generator import ReferenceGenerator
from ppc_attitude.nodes.spacecraft_plant import SpacecraftPlant
from ppc_attitude.processes.exits import BAD_INPUT
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.stamps import nanoseconds, stamp_of
from ppc_attitude.simulation.replay import replay

pytestmark = pytest.mark.ros


# The graph forgets a node that was killed only after seconds, and until then may be slow.
@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
@pytest.mark.parametrize("mode", ["free-running", "lockstep"])
def test_nodes_join_late_and_again_in_any_order(
    mode: str, number: signal.Signals, tmp_path: Path, start_process: StartProcess
) -> None:
    def end(node: Node) -> None:
        node.send(number)
        assert node.ends() == (-number if number == signal.SIGKILL else 0), node.err

    with peer() as stack:
        nodes = loop_nodes(start_process, tmp_path, mode, PLANT)
        waits = "no torque_command: zero torque" if mode == "free-running" else "waiting at t"
        stack.hears(PLANT, waits)
        if mode == "free-running":
            stack.until(lambda: stack.time(APPLIED_TORQUE) > 0.5, "time to go on")
            assert last_torque(stack) == 0.0

        nodes |= loop_nodes(start_process, tmp_path, mode, CONTROLLER, INJECTOR)
        stack.hears(CONTROLLER, "waiting for reference/attitude")
        nodes |= loop_nodes(start_process, tmp_path, mode, REFERENCE)
        stack.goes_on()
        stack.until(lambda: last_torque(stack) > 0.0, "torque")
        stack.hears(PLANT, "running")

        end(nodes[CONTROLLER])
        stack.hears(PLANT, waits)
        killed_at = stack.time(APPLIED_TORQUE)
        if mode == "free-running":
            stack.until(lambda: last_torque(stack) == 0.0, "zero torque")
        nodes[CONTROLLER] = Node(start_process, tmp_path, CONTROLLER, mark="_again")
        stack.goes_on()
        stack.hears(PLANT, "running")
        ((start, error),) = until(lambda: plans(nodes[CONTROLLER]), "a plan")
        assert start >= killed_at - 0.05
        assert 0.0 < error < 180.0

        end(nodes[PLANT])
        stack.forget()
        nodes[PLANT] = Node(
            start_process, tmp_path, PLANT, *(LOCKSTEP if mode == "lockstep" else ()), mark="_again"
        )
        nodes[CONTROLLER].says("time has begun again")
        stack.goes_on()
        until(lambda: plans(nodes[CONTROLLER])[-1][0] < killed_at, "a plan of the new time")
        stack.hears(PLANT, "running")
        end_all(nodes.values())


def test_a_plant_that_runs_free_says_which_first_answer_it_waits_for(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    clock = [0.0]
    monkeypatch.setattr(SpacecraftPlant, "now", lambda _: clock[0])
    with living(SpacecraftPlant, "wait_for_recorder:=true") as plant:
        for clock[0] in (0.0, 10.0):
            plant.wake()
    told = "waiting at t = 0.000 s for torque_command, disturbance/torque; nobody publishes"
    assert told in capfd.readouterr().err


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["lockstep:=true", "wait_for:=[]"], "wait_for = []; allowed in lock-step: torque_co"),
        (["rate:=1.9"], "command_timeout = 0.5 s; allowed on the wall clock: ≥ 0.5"),
        (["rate:=30.0", "command_timeout:=0.0333333"], "≥ 0.033333333 s, one step"),
    ],
)
def test_a_plant_that_waits_for_nobody_or_finds_every_command_late_is_refused(
    given: list[str], told: str
) -> None:
    with pytest.raises(ConfigurationError, match=re.escape(told)), living(SpacecraftPlant, *given):
        pass


def test_a_command_may_be_a_step_old_at_every_rate() -> None:
    with living(SpacecraftPlant, "rate:=30.0", f"command_timeout:={1.0 / 30.0}"):
        pass


def test_what_is_taken_off_for_a_disturbance_is_no_saturation() -> None:
    inputs = {topic.column: values for topic, values in INSTANT.items()}
    with living(PpcController, "rate_observer:=1.0", "disturbance_feedforward:=true") as node:
        for step in range(30):
            turning = {"angular_velocity": (1e-5 * step, 0.0, 0.0)}
            told = node.compute(stamp_of(step, 100.0), inputs | turning)
        assert told["torque_command"] != told["unsaturated_torque"]
        assert node.details()["steps in saturation"] == 0
        for step in (30, 31):  # one odd sample is not believed
            node.compute(stamp_of(step, 100.0), inputs | {"angular_velocity": (0.1, 0.0, 0.0)})
        assert node.details()["steps in saturation"] == 1


def test_a_plant_finds_who_publishes_under_another_name() -> None:
    with living(SpacecraftPlant, rules=[f"{TORQUE_COMMAND.name}:=command"]) as plant:
        plant.create_publisher(WrenchStamped, "command", 1)
        until(lambda: plant.is_published(TORQUE_COMMAND.name), "the publisher")


@pytest.mark.parametrize("kind", [DisturbanceInjector, ReferenceGenerator])
def test_who_needs_but_the_time_takes_it_from_the_truth_where_it_is_sent(kind: Any) -> None:
    """An estimator that stops would stop the environment, too."""
    answered: list[int] = []
    with living(kind) as node, closing(Beside(node, ATTITUDE, TRUE_ATTITUDE)) as beside:
        passed = 0.0
        node.now = lambda: time.monotonic() + passed
        node.on_instant = lambda stamp_ns, _: answered.append(stamp_ns)
        beside.meet()
        for stamp in (1, 2):
            beside.send(TRUE_ATTITUDE, stamp, UNIT)
            beside.until(partial(answered.count, stamp))
        beside.send(ATTITUDE, 3, UNIT)
        beside.until(lambda: node.heard == 3)
        assert answered == [1, 2]
        passed = 60.0  # the truth is sent no longer
        beside.send(ATTITUDE, 4, UNIT)
        beside.until(lambda: answered == [1, 2, 4])


REFUSED = {
    "out of range": (CONTROLLER, "k", -1.0, "k = -1.0; allowed: finite, > 0"),
    "infeasible": (CONTROLLER, "rate_envelope.exponential_terminal", 1e-9, "rate_envelope"),
    "at start only": (PLANT, "rate", 50.0, "rate"),
    "unknown": (INJECTOR, "enviroment", True, "did you mean environment?"),
    "no such part": (
        PLANT,
        "faults",
        ["wheel/7 seized"],
        "no selected component has a part wheel/7",
    ),
    "truth not sent": (PLANT, "rate_noise", 1e-6, "restart it with send_truth = true"),
    "not together": (INJECTOR, "pulse_times", [1.0, 2.0], "pulse"),
}


HEAVIER = [3.0, 0.0, 0.0, 0.0, 2.5, 0.0, 0.0, 0.0, 1.9]
# So large that the controller is always at its limit.
LASTING_HIT = """/**/disturbance_injector:
  ros__parameters: {pulse_times: [0.0], pulse_durations: [1e6], pulse_torques: [0.3, 0.3, 0.3]}
"""


def test_parameters_in_flight_are_refused_with_reasons_or_act_and_are_replayed_after_a_reset_too(
    tmp_path: Path, start_process: StartProcess
) -> None:
    run = Run(start_process, tmp_path / "bag", *ENDLESS, overlay=pace(0.5) + LASTING_HIT)
    with peer() as stack:
        stack.goes_on(0.2)
        for case, (node, name, value, reason) in REFUSED.items():
            result = stack.set_parameter(node, name, value)
            assert not result.successful, case
            assert reason in result.reason, case
        assert stack.set_parameter(CONTROLLER, "k", 0.9).successful
        assert stack.set_parameter(PLANT, "max_torque", 0.03).successful
        assert stack.set_parameter(PLANT, "inertia", HEAVIER).successful
        stack.until(lambda: last_torque(stack) == 0.03, "the new limit")
        switch(stack, False)
        stack.until(lambda: last_torque(stack) == 0.0, "zero torque")
        before = stack.time(APPLIED_TORQUE)
        assert stack.call(Trigger, f"/{PLANT}/reset", Trigger.Request()).success
        stack.until(lambda: stack.time(APPLIED_TORQUE) < before, "time to go back")
        stack.goes_on(0.2)
        switch(stack, True)
        stack.until(lambda: last_torque(stack) == 0.03, "torque")
        stack.goes_on(0.2)
        asked_at = stack.time(TORQUE_COMMAND)
        assert stack.set_parameter(CONTROLLER, "max_torque", 0.02).successful
        stack.until(lambda: last_torque(stack) == 0.02, "the new limit")
        stack.goes_on(0.2)
        run.send(signal.SIGINT)
        assert run.ends() == 3, run.err
    assert "inertia: every node with this parameter needs the same value" in run.err
    assert "max_torque: every node" not in run.err
    record = read_run(run.bag)
    assert record.missing_messages == 0
    assert record.parameters[CONTROLLER]["k"] == 0.9
    assert record.parameters[PLANT]["max_torque"] == 0.03
    assert [(each.name, each.value) for each in record.changes] == [
        ("enabled", False),
        ("enabled", True),
        ("max_torque", 0.02),
    ]
    largest = np.abs(record["torque_command"]).max(axis=1)
    (changed,) = np.flatnonzero(np.diff(largest) < -0.02) + 1  # one step: before it old, then new
    assert record.t[changed] > asked_at
    assert (largest[changed:] == 0.02).all()
    changed_by_user = {event for event in events(run.bag) if event[0] == f"/{CONTROLLER}"}
    told = {("k", 0.9), ("max_torque", 0.02)}
    assert changed_by_user == {(f"/{CONTROLLER}", *each) for each in told}
    assert [each.largest for each in replay(record).found] == [0.0] * 5


def test_an_environment_that_tells_other_topics_is_not_taken_in_flight() -> None:
    with living(DisturbanceInjector) as node:
        (answer,) = node.set_parameters([Parameter("environment", value="orbit")])
        assert not answer.successful
        assert "orbit, pulses would read or publish other topics than now" in answer.reason
        assert "restart the node with this selection" in answer.reason


def switch(stack: Peer, enabled: bool) -> None:
    assert stack.call(SetBool, f"/{CONTROLLER}/enable", SetBool.Request(data=enabled)).success


def events(bag: Path) -> set[tuple[str, str, float]]:
    """Node, name and value of each changed number in a bag, read with rosbags alone."""
    found = set()
    with AnyReader([bag]) as reader:
        links = [each for each in reader.connections if each.topic == "/parameter_events"]
        for link, _, data in reader.messages(connections=links):
            event: ParameterEvent = reader.deserialize(data, link.msgtype)
            for changed in event.changed_parameters:
                found.add((event.node, changed.name, changed.value.double_value))
    return found


def test_a_reference_refuses_goals_by_its_mode_and_says_that_it_has_years_to_integrate(
    tmp_path: Path, start_process: StartProcess, capfd: pytest.CaptureFixture[str]
) -> None:
    """Years as beside hardware that counts from its own start, or when it joins a long run."""
    reference = Node(start_process, tmp_path, REFERENCE)
    reference.says("ready")
    assert main(["goto", "--euler", "0", "0", "30"]) == BAD_INPUT
    told = "error: reference_generator: mode = 'paper'; allowed: 'goal', which takes goals\n"
    assert capfd.readouterr().err == told
    with peer(ATTITUDE) as hardware:
        hardware.matched(ATTITUDE, [REFERENCE])
        for second in range(5):
            stamp = nanoseconds(9e7 + second)
            hardware.send(ATTITUDE, Codec(ATTITUDE).encode(stamp, (0.0, 0.0, 0.0, 1.0)))
        reference.says("integrating the motion from zero to the state's stamp: 0 s of 9000000")
        reference.send(signal.SIGTERM)
        assert reference.ends() == 0, reference.err


def test_a_node_needs_no_outlets(tmp_path: Path, start_process: StartProcess) -> None:
    closed = ("bash", "-c", 'exec "$@" <&- >&- 2>&-', "bash")
    plant = Node(start_process, tmp_path, PLANT, "duration:=0.1", before=closed)
    assert plant.ends() == 0
