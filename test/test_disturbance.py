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

import numpy as np
from synthetic import environment

from ppc_attitude.science.component import Component
from ppc_attitude.science.disturbances import pulses
from ppc_attitude.science.disturbances.pulses import PULSE, configuration_of, scheduled_pulses
from ppc_attitude.science.environments import none, paper
from ppc_attitude.science.environments.paper import ENVIRONMENT_BOUND, environment_torque
from ppc_attitude.science.part import Part
from ppc_attitude.science.stamps import span


def external_torque(stamp_ns: int, kind: Component, acting: np.ndarray) -> tuple[float, ...]:
    """Give what the injector gives: the torque of an environment and the pulses."""
    surroundings = Part(kind, {})
    sudden = Part(pulses.COMPONENT, {each.name: [] for each in pulses.COMPONENT.parameters})
    sudden.hold(configuration_of(acting)[0])
    return tuple(sudden.step(stamp_ns, surroundings.step(stamp_ns)))


def test_environment_is_the_printed_one_and_bounded() -> None:
    times = np.linspace(0.0, 700.0, 7001)  # more than a period of each term
    torques = np.array([environment_torque(t) for t in times])
    assert np.allclose(torques, environment(times), rtol=1e-14)
    largest = np.linalg.norm(torques, axis=1).max()
    assert largest <= ENVIRONMENT_BOUND
    assert largest > 0.9995 * ENVIRONMENT_BOUND  # the bound is not idle


def test_a_pulse_acts_from_its_first_nanosecond_and_not_at_its_last() -> None:
    acting = np.array([(2_000_000_000, 2_100_000_000, (0.1, 0.2, 0.3))], PULSE)
    at = {
        stamp: external_torque(stamp, none.COMPONENT, acting)
        for stamp in (1_999_999_999, 2_000_000_000, 2_099_999_999, 2_100_000_000)
    }
    assert list(at.values()) == [(0, 0, 0), (0.1, 0.2, 0.3), (0.1, 0.2, 0.3), (0, 0, 0)]


def test_overlapping_pulses_and_the_environment_add_up() -> None:
    acting = np.array([(0, 100, (0.5, 0.0, 0.0)), (50, 100, (0.25, 0.0, -1.0))], PULSE)
    assert external_torque(75, none.COMPONENT, acting) == (0.75, 0.0, -1.0)
    expected = environment(np.array([75e-9]))[0] + (0.75, 0.0, -1.0)
    assert np.allclose(external_torque(75, paper.COMPONENT, acting), expected, rtol=1e-14)


def test_a_scheduled_pulse_acts_over_its_span() -> None:
    values = {"pulse_times": [1.12], "pulse_durations": [0.64], "pulse_torques": [0.1, 0.0, 0.0]}
    (only,) = scheduled_pulses(values)
    assert (only["start_ns"], only["end_ns"]) == span(1.12, 0.64)
