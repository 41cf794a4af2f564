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

"""Injected torques: from which stamp to which they act, what the injector says, what it refuses."""

import math
from contextlib import suppress

import numpy as np
import pytest
from peer import living
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter as RosParameter

from ppc_attitude.contract.topics import DISTURBANCE
from ppc_attitude.nodes.disturbance_injector import DisturbanceInjector
from ppc_attitude.runtime.injection import Injections
from ppc_attitude.runtime.stamps import RefusedError
from ppc_attitude.science.disturbances.pulses import PULSE, with_pulses
from ppc_attitude.science.stamps import nanoseconds, stamp_of

TORQUE = (0.1, -0.2, 0.3)
LIMIT = 0.3


class Injector:
    """Sums up the pulses of every instant, as the node does, one instant ahead of the states."""

    def __init__(self) -> None:
        self.injections = Injections()
        self._pulses = np.zeros(0, PULSE)
        self.step = 0
        self.acted: list[float] = []

    def runs(self, until: int) -> None:
        for step in range(self.step, until):
            if self.injections.at(stamp_of(step, 100.0)):
                self._pulses = np.concatenate([np.zeros(0, PULSE), *self.injections.pulses])
            self.acted.append(with_pulses(stamp_of(step, 100.0), (0.0, 0.0, 0.0), self._pulses)[0])
        self.step = until

    def accept(self, start: float, duration: float, known: bool = True) -> str:
        stamps = (stamp_of(self.step, 100.0), 10_000_000) if known else (None, 0)
        return self.injections.accept(TORQUE, round(start * 1e9), duration, LIMIT, *stamps)

    def steps(self) -> list[int]:
        return [step for step, torque in enumerate(self.acted) if torque]


def test_what_is_past_acts_now_and_what_is_to_come_when_it_says() -> None:
    injector = Injector()
    injector.runs(7)
    assert "from t = 0.070000 s" in injector.accept(0.03, 0.02)
    assert "from t = 0.150000 s to 0.170000 s" in injector.accept(0.15, 0.02)
    injector.runs(30)
    assert injector.steps() == [7, 8, 15, 16]
    assert not injector.injections.at(stamp_of(30, 100.0))  # nothing is to be added up anew


def test_the_answer_tells_what_acts_from_state_to_state() -> None:
    injector = Injector()
    injector.runs(7)
    assert injector.accept(0.103, 0.02).endswith("from t = 0.110000 s to 0.130000 s")
    assert injector.accept(0.195, 0.006).endswith("from t = 0.200000 s to 0.210000 s")
    assert injector.accept(0.0, 0.001).endswith("from t = 0.070000 s to 0.080000 s")
    with pytest.raises(
        RefusedError, match=r"start = 0\.153 s and duration = 0\.005 s: no state lies"
    ):
        injector.accept(0.153, 0.005)
    with pytest.raises(RefusedError, match=r"≥ 0\.333333333 s"):  # no digit is lost
        Injections().accept(TORQUE, 333_333_334, 0.1, LIMIT, 0, 333_333_333)
    gap = Injections().accept(TORQUE, 103_000_000, 0.02, LIMIT, None, 10_000_000)
    assert gap.endswith("from t = 0.103000 s to 0.123000 s")  # nobody knows the stamps to come
    injector.runs(30)
    assert injector.steps() == [7, 11, 12, 20]
    assert injector.injections.accepted == 3


def test_before_any_state_it_acts_from_the_first_one_on() -> None:
    injector = Injector()
    assert injector.accept(0.0, 0.03, known=False).endswith("from the next state on for 0.03 s")
    injector.step = 500
    injector.runs(520)
    assert injector.steps() == [0, 1, 2]


def test_overlapping_ones_add_up_each_with_its_own_duration() -> None:
    injector = Injector()
    injector.accept(0.0, 0.02)
    injector.accept(0.0, 0.04)
    injector.accept(9.0, 0.04)
    assert injector.injections.pending == 3
    injector.runs(6)
    assert injector.acted == pytest.approx([0.2, 0.2, 0.1, 0.1, 0.0, 0.0])


@pytest.mark.parametrize("rate", [24.0, 60.0, 1024.0])
def test_one_of_whole_steps_acts_for_as_many_at_every_rate(rate: float) -> None:
    injections = Injections()
    for step in range(300):
        stamp = stamp_of(step, rate)
        injections.accept(TORQUE, 0, 4.0 / rate, LIMIT, None, 0)
        injections.at(stamp)
        acting = with_pulses(stamp, (0.0, 0.0, 0.0), np.concatenate(injections.pulses))
        assert acting[0] == pytest.approx(0.1 * min(step + 1, 4)), step


def test_time_that_begins_again_ends_them() -> None:
    injector = Injector()
    injector.runs(3)
    injector.accept(0.0, 10.0)
    injector.runs(5)
    injector.accept(0.0, 10.0)  # of the next instant, which does not come
    injector.injections.begin_again()
    injector.step, injector.acted = 0, []
    injector.runs(5)
    assert injector.acted == [0.0] * 5
    assert injector.injections.pending == 0
    injector.injections.begin_again()
    injector.step, injector.acted = 0, []
    injector.accept(0.03, 0.01)  # what is past by the time before is to come by the new one
    injector.runs(5)
    assert injector.steps() == [3]


def test_too_much_is_refused_with_what_is_allowed_and_changes_nothing() -> None:
    injector = Injector()
    with pytest.raises(RefusedError, match=r"allowed: up to 0\.3 N·m per axis"):
        injector.injections.accept((0.0, 0.0, -1.5), 0, 1.0, LIMIT, None, 0)
    assert (injector.injections.accepted, injector.injections.pending) == (0, 0)
    for begin in (0.0, 1.0):  # one waits for the next instant, the other for its own
        for _ in range(500):
            injector.accept(begin, 0.05)
    with pytest.raises(RefusedError, match="1000 pulses are pending or active"):
        injector.accept(1.0, 0.05)
    injector.runs(200)
    injector.accept(3.0, 0.05)
    assert injector.injections.pending == 1


def asked(name: str, kind: int, **value: object) -> Parameter:
    return Parameter(name=name, value=ParameterValue(type=kind, **value))


GOOD = asked("torque", ParameterType.PARAMETER_DOUBLE_ARRAY, double_array_value=TORQUE)
WHOLE = asked("torque", ParameterType.PARAMETER_INTEGER_ARRAY, integer_array_value=[1, 0, 0])
LATER = asked("start", ParameterType.PARAMETER_INTEGER, integer_value=2)


@pytest.mark.ros
@pytest.mark.parametrize(
    ("parameters", "told"),
    [
        ([WHOLE, LATER], "(1.0, 0.0, 0.0) N·m acts from t = 2.000000 s to 2.100000 s"),
        ([], "inject: torque = [] has 0 values; allowed: finite, up to ±1e+30, 3 values"),
        ([asked("torque", 8, double_array_value=[math.nan] * 3)], "inject: torque = nan N·m;"),
        ([GOOD, asked("end", 1)], "inject has no parameter end"),
        ([asked("torque", 77)], "unexpected parameter type 77"),
        ([asked("torque", 9)], "inject: torque = [] has 0 values"),
        ([GOOD, asked("start", 1)], "inject: start = False s; allowed: finite, ≥ 0, ≤ 1e+08"),
        ([GOOD, asked("duration", 3)], "inject: duration = 0.0 s; allowed: finite, ≥ 1e-09"),
    ],
)
def test_a_request_of_other_numbers_is_refused_by_name(
    parameters: list[Parameter], told: str
) -> None:
    with living(DisturbanceInjector) as node:
        request = SetParametersAtomically.Request(parameters=parameters)
        answer = node._on_request(request, SetParametersAtomically.Response()).result
    assert answer.reason.startswith(told)
    assert answer.successful == ("acts" in told)


def test_a_request_that_comes_again_by_its_name_acts_once_and_gets_the_same_answer() -> None:
    injector = Injector()

    def ask(name: str) -> str:
        now = stamp_of(injector.step, 100.0)
        return injector.injections.accept(TORQUE, 0, 0.02, LIMIT, now, 0, name)

    injector.runs(7)
    first = ask("mine")
    injector.runs(15)
    assert ask("mine") == first
    assert ask("another") != first
    injector.runs(30)
    assert injector.steps() == [7, 8, 15, 16]
    assert injector.injections.accepted == 2
    injector.injections.begin_again()  # what was forgotten acts if it is asked for again
    injector.step, injector.acted = 0, []
    injector.runs(3)
    assert "from t = 0.030000 s" in ask("mine")
    injector.runs(9)
    assert injector.steps() == [3, 4]
    for number in range(100):
        ask(str(number))
    accepted = injector.injections.accepted
    ask("0")
    assert injector.injections.accepted == accepted, "the last hundred are remembered"
    ask("mine")
    assert injector.injections.accepted == accepted + 1, "and none before them"


@pytest.mark.ros
def test_what_is_injected_acts_on_when_a_parameter_is_set() -> None:
    with living(DisturbanceInjector, "environment:=false") as node:
        node._inject(TORQUE, 0, 10.0)
        for t in (0.0, 0.01):
            node.on_instant(nanoseconds(t), {})
        node.set_parameters([RosParameter("injection_duration", value=2.0)])
        node.on_instant(nanoseconds(0.02), {})
        acting = node.chain.step(nanoseconds(0.02), {})[DISTURBANCE.column]
    assert acting == TORQUE


@pytest.mark.ros
def test_a_gap_of_the_states_ends_none_and_time_that_begins_again_all(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with living(DisturbanceInjector) as node:

        def pending_after(*times: float) -> int:
            for t in times:
                with suppress(RefusedError):  # the first two of another time
                    node.on_instant(nanoseconds(t), {})
            return node._injections.pending

        assert pending_after(0.0, 0.1) == 0
        node._inject(TORQUE, nanoseconds(70.0), 1.0)
        assert pending_after(60.0, 60.1, 60.2) == 1
        assert "forgotten" not in capfd.readouterr().err
        node.health.begin_again()
        assert pending_after(0.0) == 0
    told = capfd.readouterr().err
    assert "time has begun again at 0.000 s: re-armed; injected torques are forgotten" in told


@pytest.mark.ros
@pytest.mark.parametrize(("start", "accepted"), [(5.001, False), (4.995, True)])
def test_a_pulse_that_would_never_act_is_refused_in_flight_too(
    start: float, accepted: bool
) -> None:
    values = {"pulse_times": [start], "pulse_durations": [0.006], "pulse_torques": [*TORQUE]}
    with living(DisturbanceInjector) as node:
        for t in (0.0, 0.01, 0.02):
            node.on_instant(nanoseconds(t), {})
        answer = node.set_parameters_atomically(
            [RosParameter(name, value=value) for name, value in values.items()]
        )
    assert ("lies between two instants of 100.0 Hz" in answer.reason) is not accepted
    assert answer.successful is accepted
