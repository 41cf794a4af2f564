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

"""Slew profiles, rotation vectors and moving frames, each against its truth table."""

import math

import numpy as np
import pytest
from guidance_helpers import DEGREE, MOTION, assert_same, guidance, motion_of, same_sign
from scipy.spatial.transform import Rotation
from truth_tables import columns, table

from ppc_attitude.science.guidance.frames import (
    GROUND,
    NADIR,
    SUN,
    quaternion_of,
)
from ppc_attitude.science.guidance.rotation import (
    about,
    axis_and_angle,
    duration,
    exponential_motion,
    profile,
    rotation_vector_rates,
    turn_between,
    turned,
)

SLEWS = table("slews")
BLEND = table("blend")
POINTING = table("pointing")
RANDOM = np.random.default_rng(7)


@pytest.mark.parametrize("i", range(len(SLEWS["angle_deg"])))
def test_profile_takes_the_least_time(i: int) -> None:
    row = {name: float(values[i]) for name, values in SLEWS.items()}
    limits = [DEGREE * row[f"{name}_limit"] for name in ("rate", "acceleration", "jerk")]
    slew = profile(DEGREE * row["angle_deg"], *limits)
    assert duration(slew) == pytest.approx(row["duration"], abs=1e-9)
    assert slew[1:] == pytest.approx(
        (row["jerk_time"], row["acceleration_time"], row["cruise_time"]), abs=1e-9
    )
    half, peak, _ = turned(0.5 * duration(slew), slew, limits[2])
    assert half == pytest.approx(DEGREE * row["angle_at_half"], abs=1e-13)
    assert peak == pytest.approx(DEGREE * row["peak_rate"], rel=1e-12)


@pytest.mark.parametrize("angle", [0.01, 1.0, 5.0, 90.0])
@pytest.mark.parametrize("jerk", [0.05, 0.2, 2.0])
def test_profile_is_smooth_and_ends_at_rest(angle: float, jerk: float) -> None:
    slew = profile(DEGREE * angle, 2.0 * DEGREE, 0.4 * DEGREE, jerk * DEGREE)
    total = duration(slew)
    assert turned(0.0, slew, jerk * DEGREE) == (0.0, 0.0, 0.0)
    assert turned(total, slew, jerk * DEGREE) == pytest.approx((DEGREE * angle, 0.0, 0.0))
    times = np.linspace(0.0, total, 2001)
    motion = np.array([turned(t, slew, jerk * DEGREE) for t in times])
    h = times[1]
    for lower, upper in ((0, 1), (1, 2)):
        quotient = np.diff(motion[:, lower]) / h
        mean = 0.5 * (motion[1:, upper] + motion[:-1, upper])
        assert np.abs(quotient - mean).max() < jerk * DEGREE * h


def test_rates_of_the_rotation_vector_are_those_of_the_blend() -> None:
    for case in np.unique(BLEND["case"]):
        rows = BLEND["case"] == case
        t = BLEND["t"][rows]
        phi = columns(BLEND, "phix", "phiy", "phiz")[rows]
        truth = columns(BLEND, *MOTION)[rows]
        # The quintic through the rows themselves: scaled, so that the fit loses nothing.
        quintic = [np.polynomial.Polynomial.fit(t, phi[:, axis], 5) for axis in range(3)]
        for k, time in enumerate(t):
            first, second = (
                tuple(float(p.deriv(order)(time)) for p in quintic) for order in (1, 2)
            )
            ours = np.concatenate(exponential_motion(tuple(phi[k]), first, second))
            assert_same(ours, truth[k], 1e-12, 1e-12, 1e-13)


@pytest.mark.parametrize("size", [1e-9, 1e-4, 0.009999, 0.010001, 0.5, 3.0])
def test_rates_of_an_exponential_invert(size: float) -> None:
    direction, first, second = RANDOM.normal(size=(3, 3))
    phi = size * direction / np.linalg.norm(direction)
    _, omega, alpha = exponential_motion(tuple(phi), tuple(first), tuple(second))
    back = rotation_vector_rates(tuple(phi), omega, alpha)
    assert np.allclose(back, (first, second), rtol=0.0, atol=1e-12)


def test_axis_of_half_a_turn_has_a_positive_first_component() -> None:
    assert axis_and_angle((-0.6, 0.8, 0.0, 0.0))[0] == (0.6, -0.8, 0.0)
    assert axis_and_angle((0.0, -1.0, 0.0, -0.0))[0] == pytest.approx((0.0, 1.0, 0.0))
    assert axis_and_angle((0.0, 0.0, -1.0, 1e-13)) == ((0.0, 0.0, 1.0), pytest.approx(math.pi))
    assert axis_and_angle((-1e-17, 1e-16, 1.0, -1e-17))[0] == pytest.approx((0.0, 0.0, 1.0))


def test_short_way_of_a_quaternion_with_a_negative_scalar() -> None:
    axis, angle = axis_and_angle(tuple(-x for x in about((0.0, 0.6, 0.8), 1.0)))
    assert axis == pytest.approx((0.0, 0.6, 0.8))
    assert angle == pytest.approx(1.0)
    assert axis_and_angle((0.0, 0.0, 0.0, -1.0))[1] == 0.0


def test_matrix_to_quaternion_on_every_branch() -> None:
    for rotation in Rotation.random(50, random_state=3):
        for turn in (Rotation.identity(), *(Rotation.from_rotvec(3.0 * e) for e in np.eye(3))):
            expected = (turn * Rotation.from_rotvec(0.1 * rotation.as_rotvec())).as_quat()
            x, y, z = Rotation.from_quat(expected).as_matrix().T
            q = np.array(quaternion_of(tuple(x), tuple(y), tuple(z)))
            assert np.abs(same_sign(q, expected) - expected).max() < 1e-15


@pytest.mark.parametrize(("frame", "name"), [(NADIR, "nadir"), (GROUND, "ground")])
def test_pointing_frames_are_the_truths(frame: int, name: str) -> None:
    sky, truth = guidance()["sky"], columns(POINTING, *(f"{name}_{x}" for x in MOTION))
    for k, t in enumerate(POINTING["t"]):
        # The truth's own state at t: the orbit has its own test.
        sky["orbit"]["position"] = columns(POINTING, "rx", "ry", "rz")[k]
        sky["orbit"]["velocity"] = columns(POINTING, "vx", "vy", "vz")[k]
        sky["earth_angle"] = math.radians(350.0) + 7.292115e-5 * t
        ours = np.concatenate(motion_of(frame, 0.0, sky))
        assert_same(ours, truth[k], 1e-12, 1e-12, 1e-13)


@pytest.mark.parametrize("frame", [NADIR, GROUND, SUN])
def test_frames_move_by_their_rates(frame: int) -> None:
    sky, t, h = guidance()["sky"], 1000.25, 0.2  # within one step of the orbit's grid
    before, now, after = (motion_of(frame, t + s, sky) for s in (-h, 0.0, h))
    axis, angle = turn_between(before[0], after[0])
    assert np.allclose(np.array(axis) * angle / (2.0 * h), now[1], rtol=1e-6, atol=1e-12)
    assert np.allclose((np.array(after[1]) - before[1]) / (2.0 * h), now[2], rtol=1e-5, atol=1e-12)


def test_sun_frame_looks_at_the_sun_across_the_orbits_normal() -> None:
    sky = guidance()["sky"]
    _, y, z = Rotation.from_quat(motion_of(SUN, 0.0, sky)[0]).as_matrix().T
    normal = np.cross(sky["orbit"]["position"], sky["orbit"]["velocity"])
    assert abs(y @ normal) < 1e-12 * np.linalg.norm(normal)
    assert z[2] < 0.0  # January: the Sun is south
