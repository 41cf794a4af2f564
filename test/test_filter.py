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
from estimation_helpers import SUITES, Array, filtered, new_memory, suite
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from ppc_attitude.science.estimators import filter as algebra
from ppc_attitude.science.estimators.filter import innovation, propagated, updated
from ppc_attitude.science.estimators.mekf import filter_record
from ppc_attitude.science.estimators.steady_state import (
    FLOOR,
    AxisKnowledge,
    after_gap,
    error_sigmas,
    first_knowledge,
    settled_knowledge,
    steady_state,
)
from ppc_attitude.science.kernel import Matrix, kernel
from ppc_attitude.science.sensors.gyro import effective_white_noise
from ppc_attitude.science.sensors.star_tracker import BORESIGHT_NOISE, CROSS_NOISE, slots

ARCSEC = math.radians(1.0 / 3600.0)
Q = tuple(Rotation.random(random_state=3).as_quat())
BIAS = (0.01, -0.02, 0.03)


def upper(a: Array) -> tuple[float, ...]:
    return tuple(a[np.triu_indices(3)])


def blocks(p: Array) -> tuple[Any, ...]:
    return upper(p[:3, :3]), tuple(map(tuple, p[:3, 3:])), upper(p[3:, 3:])


def whole(known: Any) -> Array:
    """P, 6 × 6, of what is known."""
    p = np.zeros((6, 6))
    for start, block in ((0, known[2]), (3, known[4])):
        half = np.zeros((3, 3))
        half[np.triu_indices(3)] = block
        p[start : start + 3, start : start + 3] = half + np.triu(half, 1).T
    p[:3, 3:] = known[3]
    p[3:, :3] = np.transpose(known[3])
    return p


def some_covariance() -> Array:
    m = np.random.default_rng(1).normal(size=(6, 6))
    return 1e-3 * m @ m.T


@pytest.mark.parametrize("angle", [1e-9, 1e-5, 9.9e-3, 1.01e-2, 0.3])
def test_propagation_is_the_exponential_of_the_error_dynamics(angle: float) -> None:
    p, h, white, walk = some_covariance(), 0.01, 1e-3, 2e-4
    phi = angle * np.array([0.48, -0.6, 0.64])
    known = propagated((Q, BIAS, *blocks(p)), tuple(phi / h + BIAS), h, white, walk)
    # δθ' = −ω × δθ − δb, δb' = 0.
    dynamics = np.zeros((6, 6))
    dynamics[:3, :3] = -np.cross(np.eye(3), phi / h)
    dynamics[:3, 3:] = -np.eye(3)
    f = expm(dynamics * h)
    q = np.diag([white * h + walk * h**3 / 3.0] * 3 + [walk * h] * 3)
    q[:3, 3:] = q[3:, :3] = -0.5 * walk * h**2 * np.eye(3)
    assert np.abs(whole(known) - (f @ p @ f.T + q)).max() < 1e-16
    turned = Rotation.from_quat(Q) * Rotation.from_rotvec(phi)
    assert np.abs(np.array(known[0]) - turned.as_quat()).max() < 1e-15


def test_the_update_is_josephs_form() -> None:
    p, z = some_covariance(), (0.01, 0.02, -0.03)
    r = np.diag([1e-3, 2e-3, 4e-3]) + 1e-4
    known = (Q, BIAS, *blocks(p))
    after = updated(known, z, upper(r))
    s = p[:3, :3] + r
    gain = p[:, :3] @ np.linalg.inv(s)
    rest = np.eye(6) - gain @ np.eye(6)[:3]
    assert np.abs(whole(after) - (rest @ p @ rest.T + gain @ r @ gain.T)).max() < 1e-17
    step = gain @ z
    assert np.allclose(np.array(after[1]) - BIAS, step[3:], rtol=1e-12)
    turned = Rotation.from_quat(Q) * Rotation.from_rotvec(step[:3])
    assert np.abs(np.array(after[0]) - turned.as_quat()).max() < 1e-15
    nis = np.square(innovation(known, z, upper(r))).sum()
    assert np.isclose(nis, z @ np.linalg.solve(s, z), rtol=1e-12)


@kernel
def cycles(known: Any, count: int, every: int, rate: Any, noise: Any, h: float) -> Any:
    """Known before and after the last of many fixes without residual."""
    fix, white, walk = noise
    covariance = (fix * fix, 0.0, 0.0, fix * fix, 0.0, fix * fix)
    before = known
    for _ in range(count):
        for _ in range(every):
            known = propagated(known, rate, h, white * white, walk * walk)
        before = known
        known = updated(known, (0.0, 0.0, 0.0), covariance)
    return before, known


# Suite, σ_n, T; σ_θ before and after a fix ["], σ_b before and after [rad/s]; and σ_θ of what is
# published an instant before the next fix arrives, which is late by one interval.
ROWS = [
    ("flagship", 1, 0.1, 0.0638066578, 0.0636771654, 3.172979494e-9, 3.172567929e-9, 0.0639),
    ("flagship", 8, 0.1, 0.2115374, 0.211463486, 3.722210992e-9, 3.721860162e-9, 0.2116),
    ("smallsat", 2, 0.1, 3.3226348, 1.71352365, 2.256260823e-6, 2.255959372e-6, 4.3758),
    ("smallsat", 10, 0.1, 5.72998344, 4.97165346, 2.257070018e-6, 2.256768676e-6, 6.3994),
    ("cubesat", 10, 0.2, 18.2916687, 8.77436889, 5.841090812e-5, 5.776345295e-5, 24.5722),
    ("cubesat", 66, 0.2, 35.9614768, 31.5781664, 6.045589926e-5, 5.983057801e-5, 40.0214),
]
OF_A_ROW = pytest.mark.parametrize("row", ROWS, ids=[f"{row[0]}-{row[1]}" for row in ROWS])


def noise_of(name: str, arcsec: float) -> tuple[float, float, float]:
    """σ_n [rad], σ_v,eff and σ_u of a suite."""
    values = suite(name)
    white = effective_white_noise(
        values["gyro.angular_random_walk"], values["gyro.resolution"], 0.01
    )
    return arcsec * ARCSEC, white, values["gyro.rate_random_walk"]


@OF_A_ROW
def test_closed_form_has_the_published_digits(row: Any) -> None:
    name, arcsec, interval = row[:3]
    before, after = steady_state(*noise_of(name, arcsec), interval)
    found = (
        math.sqrt(before.attitude) / ARCSEC,
        math.sqrt(after.attitude) / ARCSEC,
        math.sqrt(before.bias),
        math.sqrt(after.bias),
    )
    assert np.allclose(found, row[3:7], rtol=5e-9)


@pytest.mark.parametrize("spin", [0.0, 0.05])
@OF_A_ROW
def test_filter_settles_where_farrenkopf_says(row: Any, spin: float) -> None:
    name, arcsec, interval = row[:3]
    noise = noise_of(name, arcsec)
    start = np.diag([noise[0] ** 2] * 3 + [suite(name)["gyro.initial_bias_sigma"] ** 2] * 3)
    known = ((0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0), *blocks(start))
    every = round(interval * 100)
    for found, expected in zip(
        cycles(known, 40_000, every, (0.0, 0.0, spin), noise, 0.01),
        steady_state(*noise, interval),
        strict=True,
    ):
        # About the spin axis each axis is alone; the other two turn into each other.
        p = whole(found)
        assert np.allclose([p[2, 2], p[2, 5], p[5, 5]], expected, rtol=1e-6, atol=0.0)
        if spin == 0.0:
            assert np.allclose(np.diag(p), [expected[0]] * 3 + [expected[2]] * 3, rtol=1e-6)


@OF_A_ROW
def test_what_is_published_is_as_old_as_the_latency(row: Any) -> None:
    """By the closed form, and by a filter at rest with late fixes; its bias is settled."""
    name, arcsec, interval = row[:3]
    noise = noise_of(name, arcsec)
    _, after = steady_state(*noise, interval)
    ages = (interval, 2.0 * interval)  # the latency is one interval
    closed = [math.sqrt(after_gap(after, *noise[1:], age).attitude) / ARCSEC for age in ages]
    assert np.abs(np.subtract(closed, (row[3], row[7]))).max() <= 5.1e-5
    if name == "flagship":
        return  # it takes an hour to settle
    every, seconds = round(interval * 100), 1000
    given = {"star_tracker__cross_noise": noise[0], "star_tracker__boresight_noise": noise[0]}
    settings = filter_record(suite(name, gyro__initial_bias_sigma=math.sqrt(after.bias), **given))
    valid = np.arange(0, 100 * seconds, every)
    rows = np.full((100 * seconds + 1, 13), np.nan)
    fixes = np.tile([0.0, 0.0, 0.0, 1.0], (valid.size, 1))
    filtered(new_memory(), settings, np.zeros((len(rows), 3)), valid, valid + every, fixes, rows)
    found = rows[-1 - every :, 7:10] / ARCSEC
    assert [found.min(), found.max()] == pytest.approx(
        [closed[0], math.sqrt(after_gap(after, *noise[1:], ages[1] - 0.01).attitude) / ARCSEC],
        rel=1e-3,
    )


@pytest.mark.parametrize("calibrated", [False, True])
@pytest.mark.parametrize("name", SUITES)
def test_a_filter_never_knows_less_than_at_first(name: str, calibrated: bool) -> None:
    """Published just before a fix arrives; the bias of a calibrated gyro is known at first."""
    given = suite(name, **({"gyro__initial_bias_sigma": 0.0} if calibrated else {}))
    attitude, bias, white = first_knowledge(given, 100.0)
    every, delay = slots(100.0, given)
    fix = given["star_tracker.boresight_noise"]
    walk = given["gyro.rate_random_walk"]
    known = AxisKnowledge(fix**2, 0.0, given["gyro.initial_bias_sigma"] ** 2)
    told = np.empty((40_000, 2))
    for k in range(len(told)):
        told[k] = after_gap(known, white, walk, (every + delay) / 100.0)[::2]
        theta, cross, b = after_gap(known, white, walk, every / 100.0)
        left = fix**2 / (theta + fix**2)
        known = AxisKnowledge(theta * left, cross * left, b - cross**2 / (theta + fix**2))
    assert np.all(told <= np.array([attitude, bias]) * (1.0 + 1e-9))


GAPS = {
    "flagship": (1, (0.075818, 0.124815, 0.319541)),
    "smallsat": (2, (28.8953, 75.3992, 221.367)),
    "cubesat": (10, (179.444, 1318.61, 12536.4)),
}


@pytest.mark.parametrize("name", SUITES)
def test_a_gap_grows_as_the_closed_form_says(name: str) -> None:
    arcsec, published = GAPS[name]
    interval = 1.0 / suite(name)["star_tracker.rate"]
    noise = noise_of(name, arcsec)
    _, after = steady_state(*noise, interval)
    p = np.kron([[after.attitude, after.cross], [after.cross, after.bias]], np.eye(3))
    known: Any = ((0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0), *blocks(p))
    step = 0
    for gap, expected in zip((10, 60, 300), published, strict=True):
        while step < 100 * gap:
            known = propagated(known, (0.0, 0.0, 0.0), 0.01, noise[1] ** 2, noise[2] ** 2)
            step += 1
        form = after_gap(after, *noise[1:], float(gap))
        assert np.isclose(math.sqrt(form.attitude) / ARCSEC, expected, rtol=5e-6)
        assert np.allclose(np.diag(whole(known))[:3], form.attitude, rtol=1e-9)
        assert np.allclose(np.diag(whole(known))[3:], form.bias, rtol=1e-9)
        assert np.allclose(known[3][0][0], form.cross, rtol=1e-9)


def test_the_floor_is_rices() -> None:
    """Once in a hundred hours: ν0 is 8 Hz with the observer, and a quarter of 100 Hz without."""
    for crossings, floor in ((8.0, 5.8), (25.0, FLOOR)):
        assert round(math.sqrt(2.0 * math.log(6.0 * crossings * 3600.0 / 0.01)), 1) == floor


LAW = {"rate_observer": 0.0, "k": 3.0, "M_omega": 0.017, "beta": 3.6}


@pytest.mark.parametrize(
    ("name", "observer", "across", "along", "rate"),
    [
        ("cubesat", 1.0, 3.57e-4, 5.82e-4, 1.20e-3),
        ("smallsat", 2.0, None, None, 4.15e-4),
        ("smallsat", 0.0, None, None, 2.6e-3),
        ("cubesat", 0.0, None, None, 1.03e-2),
    ],
)
def test_published_noise_floors(
    name: str, observer: float, across: float | None, along: float | None, rate: float
) -> None:
    noises, law = suite(name), {**LAW, "rate_observer": observer}
    of_axes = [  # across the boresight as well as about it
        error_sigmas(law, 100.0, *settled_knowledge({**noises, BORESIGHT_NOISE.name: noise}, 100.0))
        for noise in (noises[CROSS_NOISE.name], noises[BORESIGHT_NOISE.name])
    ]
    if across is not None:
        attitude = [FLOOR * each.attitude for each in of_axes]
        assert attitude == pytest.approx([across, along], rel=2e-3)
    assert FLOOR * of_axes[0].rate == pytest.approx(rate, rel=1e-2)


component = st.floats(-10.0, 10.0)
vectors = st.tuples(component, component, component)
matrices = st.tuples(vectors, vectors, vectors)


@given(matrices, matrices, vectors, component)
def test_matrices_are_numpys(m: Matrix, n: Matrix, a: tuple[float, float, float], s: float) -> None:
    x, y = np.array(m), np.array(n)
    upper = np.triu_indices(3)
    assert np.array_equal(algebra.transposed(m), x.T)
    assert np.array_equal(algebra.sum_of(m, n), x + y)
    assert np.array_equal(algebra.scaled(s, m), s * x)
    # In the order of a dot product, so that numbers are the same whoever computes them.
    dots = [[r[0] * c[0] + r[1] * c[1] + r[2] * c[2] for c in n] for r in m]
    assert np.array_equal(algebra.times_transposed(m, n), dots)
    square = x @ x.T + np.eye(3)
    packed = tuple(square[upper])
    assert np.allclose(
        algebra.plus_diagonal(algebra.symmetric_product(m, m), 1.0), packed, atol=1e-12
    )
    assert np.array_equal(algebra.full(packed), square)
    assert np.array_equal(algebra.symmetric_sum(packed, packed), 2.0 * square[upper])
    factor = algebra.cholesky(packed)
    lower = np.linalg.cholesky(square)
    # The factor is packed by columns: xx yx zx yy zy zz.
    assert np.allclose(factor, lower.T[upper], rtol=1e-9, atol=1e-9)
    assert np.allclose(lower @ algebra.forward(factor, a), a, atol=1e-9)
    assert np.allclose(square @ algebra.solved(factor, a), a, atol=1e-7)
