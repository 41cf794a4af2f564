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

import math
from typing import Any

import numpy as np
import pytest
from craft_helpers import part_of
from estimation_helpers import Array, suite
from scipy.spatial.transform import Rotation

from ppc_attitude.science.kernel import kernel
from ppc_attitude.science.kinds import SENSORS
from ppc_attitude.science.noise import normal_pair
from ppc_attitude.science.sensors.gyro import (
    NOISE,
    effective_white_noise,
    gyro_noise,
    gyro_record,
    gyro_sample,
    mean_rate,
    walked_bias,
)
from ppc_attitude.science.stamps import stamp_of


@kernel
def at_rest(gyro: Any, h: float, samples: Any) -> None:
    bias = (0.0, 0.0, 0.0)
    noise = np.zeros(1, NOISE)[0]
    for k in range(samples.shape[0]):
        white, walk = gyro_noise(gyro, k + 1, noise)
        after = walked_bias(gyro, bias, walk, h)
        middle = (
            0.5 * (bias[0] + after[0]),
            0.5 * (bias[1] + after[1]),
            0.5 * (bias[2] + after[2]),
        )
        sample = gyro_sample(gyro, (0.0, 0.0, 0.0), middle, white, h)
        samples[k, 0], samples[k, 1], samples[k, 2] = sample
        bias = after


def allan_deviation(rates: Array, steps: int) -> float:
    """Overlapping Allan deviation of mean rates over so many steps, all axes together."""
    angle = np.vstack([np.zeros(3), rates.cumsum(axis=0)])
    second = angle[2 * steps :] - 2.0 * angle[steps:-steps] + angle[: -2 * steps]
    return float(np.sqrt(0.5 * np.mean(second**2)) / steps)


def expected_deviation(values: dict[str, Any], tau: float) -> float:
    white, walk = values["gyro.angular_random_walk"], values["gyro.rate_random_walk"]
    return math.sqrt(white**2 / tau + walk**2 * tau / 3.0)


@pytest.mark.parametrize("name", ["flagship", "smallsat", "cubesat"])
@pytest.mark.parametrize(
    ("h", "count", "tolerances"),
    [
        (0.01, 100_000, {1: 0.03, 10: 0.03, 100: 0.03}),
        (1.0, 1_000_000, {10: 0.02, 100: 0.02, 1000: 0.06, 10_000: 0.2}),
    ],
)
def test_allan_deviation_is_that_of_the_noise_parameters(
    name: str, h: float, count: int, tolerances: dict[int, float]
) -> None:
    values = suite(name, gyro__resolution=0.0)
    samples = np.empty((count, 3))
    at_rest(gyro_record({**values, "gyro.initial_bias_sigma": 0.0, "seed": 1}), h, samples)
    for steps, tolerance in tolerances.items():
        found = allan_deviation(samples, steps) / h
        assert found * h == pytest.approx(expected_deviation(values, steps * h), rel=tolerance)


def test_a_walk_alone_has_its_deviation_from_one_sample_on() -> None:
    """A sample is the mean of a walking bias, which differs from the mean of its ends."""
    values = suite(
        "flagship",
        gyro__angular_random_walk=0.0,
        gyro__rate_random_walk=1e-6,
        gyro__initial_bias_sigma=0.0,
        gyro__resolution=0.0,
    )
    samples = np.empty((200_000, 3))
    at_rest(gyro_record({**values, "seed": 4}), 1.0, samples)
    for steps in (1, 2, 5):
        deviation = allan_deviation(samples, steps)
        assert deviation == pytest.approx(expected_deviation(values, steps), rel=0.01)


def test_mean_rate_is_the_true_rotation_vector() -> None:
    turn = Rotation.from_rotvec([0.03, -0.2, 0.1])
    before = Rotation.random(random_state=1)
    q, p = tuple(before.as_quat()), tuple((before * turn).as_quat())
    for after in (p, tuple(-x for x in p)):  # a quaternion and its opposite are one attitude
        assert mean_rate(q, after, 0.5) == pytest.approx((0.06, -0.4, 0.2), rel=1e-13)


def read(rate: tuple[float, float, float], **given: Any) -> tuple[float, ...]:
    noiseless = suite(
        "flagship", gyro__angular_random_walk=0.0, gyro__rate_random_walk=0.0, **given
    )
    zero = (0.0, 0.0, 0.0)
    return tuple(gyro_sample(gyro_record({**noiseless, "seed": 0}), rate, zero, zero, 0.01))


def test_clipping_then_rounding() -> None:
    assert read((0.5, -0.5, 0.0), gyro__full_scale=0.1) == (0.1, -0.1, 0.0)
    rounded = read((0.024, -0.026, 0.5), gyro__resolution=0.02, gyro__full_scale=0.2)
    assert rounded == pytest.approx((0.02, -0.02, 0.2))
    for finest in (0.0, 1e-320):
        assert read((0.024, -0.026, 0.0), gyro__resolution=finest) == (0.024, -0.026, 0.0)


def test_scale_factors_and_misalignments_are_where_the_page_says() -> None:
    given = {
        "gyro__scale_factor": [0.01, 0.02, 0.03],
        "gyro__misalignment": [0.001, 0.002, 0.003, 0.004, 0.005, 0.006],  # xy xz yx yz zx zy
        "gyro__full_scale": 100.0,
    }
    m = [[1.01, 0.001, 0.002], [0.003, 1.02, 0.004], [0.005, 0.006, 1.03]]
    for i in range(3):
        unit = tuple(np.eye(3)[i])
        assert read(unit, **given) == pytest.approx(np.array(m)[:, i])


def test_the_seed_draws_what_is_not_fixed() -> None:
    values = suite(
        "smallsat",
        gyro__initial_bias=[1.0, 0.0, 0.0],
        gyro__scale_factor_sigma=1e-3,
        gyro__misalignment_sigma=2e-3,
    )
    records = [gyro_record({**values, "seed": seed}) for seed in range(2000)]
    bias = np.array([record["initial_bias"] for record in records]) - [1.0, 0.0, 0.0]
    m = np.array([record["response"] for record in records]) - np.eye(3)
    scales, sides = m[:, range(3), range(3)], m[:, ~np.eye(3, dtype=bool)]
    for drawn, sigma in ((bias, 30.0 * math.radians(1.0 / 3600.0)), (scales, 1e-3), (sides, 2e-3)):
        assert np.std(drawn) == pytest.approx(sigma, rel=0.04)
    together = np.corrcoef(np.hstack([bias, scales, sides]).T)
    assert np.abs(together - np.eye(12)).max() < 0.1
    again = gyro_record({**values, "seed": 7})
    assert np.array_equal(again["response"], records[7]["response"])


def test_rounding_acts_as_white_noise() -> None:
    values = suite("cubesat", gyro__initial_bias_sigma=0.0, gyro__rate_random_walk=0.0)
    samples = np.empty((100_000, 3))
    at_rest(gyro_record({**values, "seed": 3}), 0.01, samples)
    white = effective_white_noise(1.6968e-4, 0.04 * math.radians(1.0), 0.01)
    assert white == pytest.approx(1.70872639588e-4, rel=1e-9)
    assert samples.std() == pytest.approx(white / 0.1, rel=5e-3)


@kernel
def noise_of(gyro: Any, step: int, noise: Any, numbers: Any) -> None:
    white, walk = gyro_noise(gyro, step, noise)
    for i in range(3):
        numbers[i], numbers[3 + i] = white[i], walk[i]


def test_the_noise_of_a_step_is_the_same_whatever_steps_came_before() -> None:
    gyro = gyro_record({**suite("smallsat"), "seed": 11})
    kept, found, alone = np.zeros(1, NOISE)[0], np.zeros(6), np.zeros(6)
    for step in (0, 1, 2, 5, 6, 8, 7, 8, 9, 3, 0):
        noise_of(gyro, step, kept, found)
        noise_of(gyro, step, np.zeros(1, NOISE)[0], alone)
        assert np.array_equal(found, alone)
        pairs = [normal_pair(11, step, channel) for channel in (8, 9, 10, 11)]
        expected = [*pairs[0], pairs[1][0], *pairs[2], pairs[3][0]]
        assert np.array_equal(found, expected)


def test_a_gyro_that_is_made_coarse_in_flight_is_warned_of_and_that_it_is_over() -> None:
    rounds = {"gyro.angular_random_walk": 1e-5, "gyro.resolution": 1e-3}
    part = part_of(SENSORS, "gyro_star_tracker")
    assert not part.advice.warning
    said = []
    for k, given in enumerate((rounds, rounds | {"gyro.resolution": 0.0})):
        part.configure({**part.component.defaults, "rate": 100.0, **given})
        part.step(stamp_of(k, 100.0), [0.0, 0.0, 0.0, 1.0, *[0.0] * 3])
        said.append((part.advices, part.advice.text, part.advice.warning))
    assert said[0][1].startswith("gyro.resolution is 10 times the noise of a sample: round")
    assert [(number, warning) for number, _, warning in said] == [(1, True), (2, False)]
    assert said[1][1] == "the gyro's rounding acts as white noise again"
