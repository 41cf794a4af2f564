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

"""The sudden disturbances of a run: found in its torque, and those of the schedule."""

from dataclasses import replace

import pytest
from craft_helpers import pulse
from synthetic import (
    environment,
    normal_run,
    pulse_torque,
    times,
    with_columns,
    with_parameters,
)

from ppc_attitude.analysis.hits import Pulse, pulses_of
from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.requirements import Requirements
from ppc_attitude.contract.run_record import Change
from ppc_attitude.contract.topics import INJECTOR, PLANT

ACTUATOR = 0.05  # [N·m]
WEAK = (9e-4, 0.0, 0.0)


def scheduled(*pulses, changes=(), duration=30.0):
    """A run of the paper's environment with pulses (start, duration, torque) on schedule."""
    _, t = times(duration)
    starts, durations, torques = zip(*pulses, strict=True)
    schedule = {
        "pulse_times": [*starts],
        "pulse_durations": [*durations],
        "pulse_torques": [number for torque in torques for number in torque],
    }
    run = with_columns(
        normal_run(duration), disturbance_torque=environment(t) + pulse_torque(t, [*pulses])
    )
    return replace(with_parameters(run, INJECTOR, schedule), changes=changes)


def test_a_scheduled_hit_counts_however_weak_it_is():
    run = scheduled((20.0, 0.1, (0.8, 0.8, 0.8)), (10.004, 2.0, WEAK))
    weak, strong = pulses_of(run, ACTUATOR)
    assert weak == Pulse(10.01, 2.0, WEAK)  # from the first instant that it acts on
    assert strong.torque == pytest.approx((0.8, 0.8, 0.8), abs=1e-6)


def test_beside_an_environment_on_record_a_weak_hit_may_begin_with_the_record():
    """Without that record it could be the environment."""
    _, t = times(30.0)
    total = environment(t) + pulse_torque(t, [(0.0, 0.1, (0.1 * ACTUATOR, 0.0, 0.0))])
    torques = {"disturbance_torque": total, "environment_torque": environment(t)}
    (hit,) = pulses_of(with_columns(normal_run(30.0), **torques), ACTUATOR)
    assert (hit.start_s, hit.duration_s) == (0.0, 0.1)


@pytest.mark.parametrize("start", [20.0, 20.1])  # on a step of the strong one
def test_a_weak_scheduled_hit_is_no_part_of_a_strong_one(start):
    given = (20.0, 0.1, (0.8, 0.8, 0.8)), (start, 2.0, WEAK)
    found = pulses_of(scheduled(*given), ACTUATOR)
    assert [(each.start_s, each.duration_s) for each in found] == [each[:2] for each in given]


@pytest.mark.parametrize(
    ("given", "found"),
    [
        ((-5.0, 10.0, WEAK), [(0.0, 5.0)]),
        ((29.0, 5.0, WEAK), [(29.0, 1.01)]),  # the last sample acts for a step
        ((30.0, 5.0, WEAK), [(30.0, 0.01)]),
        ((0.0, 40.0, WEAK), []),  # never begins nor ends
        ((31.0, 1.0, WEAK), []),
        ((5.0, 1.0, (0.0, 0.0, 0.0)), []),
        ((5.0, 1.0, (0.0, float("nan"), 0.0)), []),
        ((float("nan"), 1.0, WEAK), []),
        (("soon", 1.0, WEAK), []),
    ],
)
def test_of_a_weak_scheduled_hit_counts_what_the_record_has_of_it(given, found):
    run = scheduled((5.0, 1.0, (0.0, 0.0, 0.0)))
    start, duration, torque = given
    schedule = pulse(start, duration, *torque)
    run = with_parameters(run, INJECTOR, schedule)
    assert [(each.start_s, each.duration_s) for each in pulses_of(run, ACTUATOR)] == found


@pytest.mark.parametrize("torque", [(0.003, 0.002, 0.001), (-0.007, 0.0, 0.0), (0.8, 0.8, 0.8)])
def test_a_scheduled_hit_may_begin_with_the_record_whatever_the_environment_is(torque):
    """A weak one was taken for the environment, and its end for a hit that lasted to the end."""
    begun, later = pulses_of(scheduled((0.0, 1.2, torque), (20.0, 0.1, (0.8, 0.8, 0.8))), ACTUATOR)
    assert (begun.start_s, begun.duration_s) == (0.0, 1.2)
    assert begun.torque == pytest.approx(torque, abs=1e-6)
    assert (later.start_s, later.duration_s) == (20.0, 0.1)


def test_a_schedule_acts_until_it_is_changed_in_flight():
    changes = (Change(11_000_000_000, INJECTOR, "pulse_torques", [0.0, 5e-4, 0.0]),)
    run = scheduled((10.0, 2.0, WEAK), changes=changes)
    assert pulses_of(run, ACTUATOR) == (
        Pulse(10.0, 1.0, WEAK),
        Pulse(11.0, 1.0, (0.0, 5e-4, 0.0)),
    )


def test_however_many_hits_are_scheduled_each_counts():
    """From the 501st on none did: their steps passed for the noise of a rough signal."""
    given = [(round(5.0 + 0.1 * k, 9), 0.05, (0.8, 0.8, 0.8)) for k in range(501)]
    found = pulses_of(scheduled(*given, duration=60.0), ACTUATOR)
    assert [(each.start_s, each.duration_s) for each in found] == [each[:2] for each in given]


@pytest.mark.parametrize("limit", [float("nan"), float("inf"), 0.0, -0.05, 10**400, "much"])
def test_an_actuator_that_means_nothing_hides_no_hit(limit):
    run = scheduled((20.0, 0.1, (0.8, 0.8, 0.8)))
    verdict = Verdict(with_parameters(run, PLANT, {"max_torque": limit}))
    assert len(verdict.hits) == 1
    assert verdict.torque_limit == ACTUATOR


def test_hits_of_a_craft_that_tells_nothing_are_found_by_its_required_torque():
    _, t = times(30.0)
    torque = pulse_torque(t, [(20.0, 0.1, (5e-4, 0.0, 0.0))])
    run = replace(with_columns(normal_run(30.0), disturbance_torque=torque), parameters={})
    assert Verdict(run).hits == ()
    (hit,) = Verdict(run, Requirements(torque=1e-4)).hits
    assert (hit.start_s, hit.duration_s) == (20.0, 0.1)
