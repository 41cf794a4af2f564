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

"""What each node says of its health: running, warned, failed or waiting, and by what numbers."""

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from peer import Patient, living
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.writer import BagWriter
from ppc_attitude.contract.declared import BY_COLUMN
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    ATTITUDE,
    DISTURBANCE,
    INJECT,
    RECORDED_TOPIC,
    REFERENCE_ACCELERATION,
    REFERENCE_ATTITUDE,
    REFERENCE_RATE,
    TORQUE_COMMAND,
    Topic,
)
from ppc_attitude.nodes.attitude_estimator import AttitudeEstimator
from ppc_attitude.nodes.attitude_markers import AttitudeMarkers
from ppc_attitude.nodes.bag_recorder import BagRecorder
from ppc_attitude.nodes.base import BaseNode
from ppc_attitude.nodes.disturbance_injector import DisturbanceInjector
from ppc_attitude.nodes.ppc_controller import PpcController
from ppc_attitude.nodes.reference_generator import ReferenceGenerator
from ppc_attitude.nodes.spacecraft_plant import SpacecraftPlant
from ppc_attitude.processes.exits import BROKEN
from ppc_attitude.runtime.health import Health, Status
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.stamps import stamp_of

OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)
UNIT, ZERO = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
STATE: dict[Topic, tuple[float, ...]] = {ATTITUDE: UNIT, ANGULAR_VELOCITY: ZERO}
ANSWERS: dict[Topic, tuple[float, ...]] = {TORQUE_COMMAND: ZERO, DISTURBANCE: ZERO}
INSTANT = {**STATE, REFERENCE_ATTITUDE: UNIT, REFERENCE_RATE: ZERO, REFERENCE_ACCELERATION: ZERO}
MEASURED: dict[Topic, tuple[float, ...]] = {
    BY_COLUMN["gyro"]: (0.0, 0.0, 0.0, 1e-7),
    BY_COLUMN["star_fix"]: (*UNIT, 1e-10, 1e-10, 1e-8),
}
# Node: what makes it run, and what it waits for without.
NEEDS: dict[type[BaseNode], tuple[dict[Topic, tuple[float, ...]], str]] = {
    ReferenceGenerator: ({ATTITUDE: UNIT}, "waiting for attitude"),
    PpcController: (INSTANT, "waiting for attitude"),
    DisturbanceInjector: ({ATTITUDE: UNIT}, "waiting for attitude"),
    SpacecraftPlant: (ANSWERS, "waiting at t = 0.010 s for torque_command, disturbance/torque"),
    AttitudeEstimator: (MEASURED, "waiting for imu/data_raw"),
    BagRecorder: (INSTANT, "waiting for attitude"),
    AttitudeMarkers: ({ATTITUDE: UNIT}, "waiting for attitude"),
}
TRACKER = ["star_tracker.cross_noise:=1.0e-5", "star_tracker.boresight_noise:=1.0e-4"]
ARGUMENTS = {
    SpacecraftPlant: ["lockstep:=true"],
    BagRecorder: ["bag:=bag"],
    AttitudeEstimator: ["estimator:=mekf", *TRACKER],
}


@pytest.fixture
def admit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Patient]]:
    monkeypatch.chdir(tmp_path)
    with ExitStack() as ward:

        def admitted(kind: type[BaseNode], *parameters: str, home: str = "/ward") -> Patient:
            given, rules = (*ARGUMENTS.get(kind, []), *parameters), [f"__ns:={home}"]
            node = ward.enter_context(living(kind, *given, rules=rules))
            feeds = [INJECT] if kind is DisturbanceInjector else []
            return ward.enter_context(closing(Patient(node, NEEDS[kind][0], *feeds)))

        yield admitted


@pytest.mark.parametrize("kind", NEEDS, ids=lambda kind: kind.executable)
def test_a_fed_node_runs_and_a_starved_one_is_stale(
    admit: Callable[..., Patient], kind: type[BaseNode]
) -> None:
    patient = admit(kind)
    patient.feed(0)
    values = patient.says(OK)
    assert {"time [s]", "measured rate [Hz]"} <= set(values)
    patient.starve()
    assert patient.says(STALE, NEEDS[kind][1])["measured rate [Hz]"] == "0"
    patient.feed(1)
    patient.said.clear()
    patient.until(lambda: not patient.node.is_idle())
    patient.node.health.begin_again()
    patient.feed(2)
    patient.says(OK)


@pytest.mark.parametrize(
    "kind", [kind for kind in NEEDS if kind is not BagRecorder], ids=lambda kind: kind.executable
)
def test_a_refusal_is_a_warning_once_with_a_count(
    admit: Callable[..., Patient], kind: type[BaseNode]
) -> None:
    patient = admit(kind)
    patient.feed(0)
    patient.says(OK)
    topic, values = next(iter(NEEDS[kind][0].items()))
    patient.give({topic: (float("nan"), *values[1:])}, 1)
    patient.until(lambda: patient.node.health.refused.total() > 0)
    step = 1 if kind is SpacecraftPlant else 2
    for level, text in ((WARN, "refused 1"), (OK, "")):
        patient.node.health.begin_again()
        patient.said.clear()
        patient.feed(step)
        assert patient.says(level, text)[f"refused {topic.name}"] == "1"
        step += 1


def test_a_running_node_says_so_once_a_second_with_its_rate(admit: Callable[..., Patient]) -> None:
    patient = admit(ReferenceGenerator, home="/")
    for told in (patient.said, patient.stamps):
        told.clear()
    for step in range(0, 201, 10):
        patient.feed(step)
    patient.until(lambda: len(patient.said) >= 3)
    assert patient.stamps == [0.0, 1.0, 2.0]
    assert {(status.level, status.message) for status in patient.said} == {(OK, "running")}
    patient.said = patient.said[-1:]
    assert patient.says(OK)["measured rate [Hz]"] == "10"


def test_repeated_steps_count_once() -> None:
    health = Health(0.0)

    def rate() -> Any:
        return health.report(Status(OK, "running", {}), "").details["measured rate [Hz]"]

    for step in (0, 0, 50, 50, 100):
        health.step(stamp_of(step, 100.0), 0.0)
    assert rate() == 2.0
    assert rate() == 0.0
    health.step(stamp_of(300, 100.0), 0.0)
    assert rate() == 0.5
    health.begin_again()
    for step in (0, 50, 100):
        health.step(stamp_of(step, 100.0), 0.0)
    assert rate() == 2.0


def test_reports_and_complaints_keep_to_their_seconds() -> None:
    health = Health(0.0)
    told = [
        step for step in (0, 99, 100, 150, 200, 500, 550) if health.step(stamp_of(step, 100.0), 0.0)
    ]
    assert told == [0, 100, 200, 500]
    health.begin_again()
    assert health.step(0, 50.0)
    assert [health.is_idle(now) for now in (51.0, 51.125)] == [False, True]
    assert not health.step(0, 51.5)  # a repeated state: time stands still
    times = (52.0, 52.125, 52.875, 53.125, 53.25)
    assert [now for now in times if health.idle_report_is_due(now)] == [52.125, 53.25]
    logged = [now for now in (0.0, 0.9, 1.0, 1.5, 2.0) if health.may_log("late", now)]
    assert logged == [0.0, 1.0, 2.0]
    assert health.may_log("early", 2.0)


def test_who_waits_also_says_how_much_it_refused() -> None:
    health = Health(0.0)
    health.refused["attitude"] += 2
    said = health.report(Status(STALE, "waiting for attitude", {}), "")
    assert said[:2] == (STALE, "waiting for attitude; refused 2 messages since the last report")


def test_a_node_whose_inputs_do_not_pair_says_so_in_the_log_while_they_come(
    admit: Callable[..., Patient], capfd: pytest.CaptureFixture[str]
) -> None:
    patient = admit(PpcController)

    def logged(step: int, seconds: float) -> str:
        """What is logged once another state has come, and then some time has passed."""
        patient.give({ATTITUDE: UNIT}, step)
        patient.until(lambda: patient.node.details()["instants incomplete"] == step - 99)
        patient.passed += seconds
        patient.node.wake()
        return capfd.readouterr().err

    for step in range(100):
        patient.give({ATTITUDE: UNIT}, step)
        patient.spin()
    assert logged(100, 4.9) == ""
    missing = "waiting for angular_velocity, reference/attitude, reference/angular_velocity"
    assert missing in logged(101, 0.2)
    patient.passed += 10.0
    patient.node.wake()
    assert capfd.readouterr().err == ""
    assert missing in logged(102, 0.0)


def test_the_controller_tells_margins_and_saturation(admit: Callable[..., Patient]) -> None:
    patient = admit(PpcController)
    patient.feed(0)
    calm = patient.says(OK, "running")
    assert calm["controller"] == "ppc"
    assert float(calm["attitude_envelope margin"]) == 1.0
    assert float(calm["rate_envelope margin"]) == 1.0
    assert (calm["steps"], calm["steps in saturation"]) == ("1", "0")
    patient.node.health.begin_again()
    patient.feed(1, angular_velocity=(0.1, 0.0, 0.0))
    hit = patient.says(WARN, "error outside rate_envelope")
    envelope = 0.08 * math.exp(-0.5 * 0.01)  # ρ_ω of Table II, 0.01 s after its beginning
    assert float(hit["rate_envelope margin"]) == pytest.approx(1.0 - 0.1 / envelope, rel=1e-3)
    assert float(hit["attitude_envelope margin"]) == 1.0
    assert hit["steps in saturation"] == "1"


def test_a_node_whose_component_gives_nan_ends_and_says_which(
    admit: Callable[..., Patient], monkeypatch: pytest.MonkeyPatch
) -> None:
    patient = admit(PpcController)
    compute = patient.node.compute

    def spoilt(stamp_ns: int, inputs: Any) -> Any:
        return {**compute(stamp_ns, inputs), "rate_error": (math.nan, 0.0, 0.0)}

    monkeypatch.setattr(patient.node, "compute", spoilt)
    patient.feed(7)
    patient.says(ERROR, "at t = 0.070 s ppc gives rate_error = (nan, 0.0, 0.0); allowed: finite")
    assert patient.node.exit_code == 3


def test_an_estimator_that_is_lost_says_so_as_an_error(admit: Callable[..., Patient]) -> None:
    patient = admit(AttitudeEstimator, "lost_sigma:=1.0e-6")
    patient.feed(0)
    values = patient.says(ERROR, "lost: no fix for 0 s, 3σ = 61.88″")  # 3 · 1e-4 rad
    assert (values["fixes"], values["fixes refused"], values["begun anew"]) == ("1", "0", "0")


def test_an_estimator_refuses_sensors_of_another_time_and_goes_on(
    admit: Callable[..., Patient],
) -> None:
    patient = admit(AttitudeEstimator)
    gyro, fix = MEASURED
    patient.feed(0)
    patient.says(OK, "tracking")
    for step in (10**6, 2 * 10**6):  # each says another time
        patient.give(MEASURED, step)
    patient.until(lambda: patient.node.health.refused[gyro.name] == 2)
    patient.until(lambda: patient.node.health.refused[fix.name] == 2)
    patient.node.health.begin_again()
    patient.give({gyro: MEASURED[gyro]}, 1)
    values = patient.says(WARN, "refused 4")
    assert (values["refused imu/data_raw"], values["refused star_tracker/attitude"]) == ("2", "2")
    assert (values["steps"], values["fixes"]) == ("2", "1")


def test_a_plant_warns_of_a_gyro_that_rounds_its_noise_away(
    admit: Callable[..., Patient], monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[Advice] = []
    monkeypatch.setattr(BaseNode, "say_all", lambda self, news: said.extend(news))
    gyro = ["gyro.angular_random_walk:=0.0", "gyro.resolution:=1.0e-3"]
    admit(SpacecraftPlant, "sensors:=gyro_star_tracker", *gyro)
    assert len(said) == 1
    assert "gyro.resolution is without noise: rounding acts" in said[0].text
    assert said[0].warning


def test_what_is_set_there_and_back_within_a_step_is_not_told(
    admit: Callable[..., Patient], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bag had a message without a change, and the log a line."""
    told: list[Any] = []
    monkeypatch.setattr(BaseNode, "tell_changes", lambda self, *given: told.append(given))
    patient = admit(PpcController)
    for k in (2.0, 3.0, 2.5):
        patient.node.set_parameters([Parameter("k", value=k)])
        if k == 3.0:
            patient.feed(0)
            patient.until(lambda: patient.node._steps == 1)
            assert told == []
    patient.feed(1)
    patient.until(lambda: patient.node._steps == 2)
    assert told == [(stamp_of(1, 100.0), {"k": 2.5})]


def test_a_pace_that_is_set_acts_at_once(admit: Callable[..., Patient]) -> None:
    """The slow one would keep the next state waiting, and with it the new one."""
    patient = admit(SpacecraftPlant, "lockstep:=true", "real_time_factor:=1.0e-6")
    patient.until(lambda: patient.node.pace._shown)
    patient.give(ANSWERS, 0)
    patient.until(lambda: patient.node.pace.step == 1)
    patient.node.set_parameters([Parameter("real_time_factor", value=0.0)])
    patient.until(lambda: patient.node.wake() and patient.node.pace._shown)


def test_a_plant_goes_on_after_bytes_that_tell_no_progress(admit: Callable[..., Patient]) -> None:
    patient = admit(SpacecraftPlant)
    progress = patient.peer.create_publisher(Clock, RECORDED_TOPIC.name, 1)
    patient.until(lambda: progress.get_subscription_count() > 0)
    progress.publish(bytes(4))
    patient.until(lambda: patient.node.health.refused[RECORDED_TOPIC.name] == 1)
    patient.feed(0)
    patient.says(WARN, "refused 1")


def test_a_disabled_controller_says_so_and_blames_no_disturbance(
    admit: Callable[..., Patient], monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[Advice] = []
    monkeypatch.setattr(BaseNode, "say_all", lambda self, news: said.extend(news))
    patient = admit(PpcController, "controller:=momentum_tube")
    patient.call(SetBool, "ppc_controller/enable", SetBool.Request(data=False))
    for step in (0, 200):
        patient.feed(step, angular_velocity=(0.0002 * step, 0.0, 0.0))
        assert patient.says(WARN, "disabled: zero torque")["steps in saturation"] == "0"
    assert not said
    for told in ("enabled: re-armed from the present error", "enabled already: the law goes on"):
        answer = patient.call(SetBool, "ppc_controller/enable", SetBool.Request(data=True))
        assert answer.message == told


def test_a_controller_that_is_told_no_attitude_any_more_says_so(
    admit: Callable[..., Patient], capfd: pytest.CaptureFixture[str]
) -> None:
    patient, nothing = admit(PpcController), (0.0, 0.0, 0.0, 0.0)
    told = "attitude is all zeros, so the attitude is unknown: zero torque"
    for step, attitude in ((0, nothing), (100, UNIT), (200, nothing), (300, UNIT)):
        patient.feed(step, attitude=attitude)
        patient.says(OK if any(attitude) else WARN, "running" if any(attitude) else told)
        patient.said.clear()
    said = capfd.readouterr().err
    assert said.count(told) == said.count(f"{told} from t = 2.000 s on") == 1
    assert "attitude is known again from t = 3.000 s on" in said


def test_the_injector_counts_what_it_takes_and_warns_of_what_it_refuses(
    admit: Callable[..., Patient],
) -> None:
    patient = admit(DisturbanceInjector)
    patient.give({INJECT: (0.1, 0.0, 0.0)}, 500)
    patient.give({INJECT: (99.0, 0.0, 0.0)})
    patient.until(lambda: patient.node.health.refused[INJECT.name] == 1)
    patient.feed(0)
    values = patient.says(WARN, "refused 1")
    assert values["injections accepted"] == "1"
    assert values["injections pending or active"] == "1"
    assert values[f"refused {INJECT.name}"] == "1"


def test_a_plant_that_diverges_says_so_before_it_ends(admit: Callable[..., Patient]) -> None:
    light = "inertia:=[1e-3, 0.0, 0.0, 0.0, 1e-3, 0.0, 0.0, 0.0, 1e-3]"
    patient = admit(SpacecraftPlant, "max_torque:=1e6", light)
    patient.feed(0, torque_command=(9e5, 9e5, 9e5))
    patient.says(ERROR, "diverged")
    assert patient.node.finished
    assert patient.node.exit_code == BROKEN


def test_a_recorder_that_cannot_write_says_so_before_it_ends(
    admit: Callable[..., Patient], monkeypatch: pytest.MonkeyPatch
) -> None:
    patient = admit(BagRecorder)
    patient.feed(0)
    assert patient.says(OK, "recording")["storage"] == "mcap"

    def full(*_: Any) -> None:
        raise BagError("bag bag cannot be written any further: No space left on device")

    monkeypatch.setattr(BagWriter, "write", full)
    patient.feed(1)
    patient.says(ERROR, "cannot be written any further")
    assert patient.node.finished
    assert patient.node.exit_code == BROKEN
