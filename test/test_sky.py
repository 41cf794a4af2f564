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

import numpy as np
import pytest
from truth_tables import columns, rows, table

from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.sky import (
    DAY,
    EARTH_RATE,
    days_of,
    earth_angle,
    lit_fraction,
    sun_direction,
    sun_distance,
)

NAMES, ROWS = rows("sun")
SUN = dict(zip(NAMES, ROWS.T, strict=True))


def test_epochs_are_those_of_the_truth() -> None:
    assert [days_of("epoch", utc) for utc in SUN["utc"]] == pytest.approx(
        SUN["days_from_j2000"].astype(float), abs=1e-9
    )


def test_sun_is_the_almanacs() -> None:
    days = SUN["days_from_j2000"].astype(float)
    ours = np.array([sun_direction(day)[0] for day in days])
    truth = np.stack([SUN[f"low_{axis}"].astype(float) for axis in "xyz"], axis=-1)
    assert np.abs(ours - truth).max() < 1e-12
    distances = [sun_distance(day) for day in days]
    assert distances == pytest.approx(SUN["low_distance_au"].astype(float), rel=1e-12)


def test_sun_is_within_the_stated_error_of_the_ephemeris() -> None:
    ours = np.array([sun_direction(float(day))[0] for day in SUN["days_from_j2000"]])
    truth = np.stack([SUN[axis].astype(float) for axis in "xyz"], axis=-1)
    assert np.rad2deg(np.linalg.norm(ours - truth, axis=1)).max() < 0.011


def test_sun_moves_by_its_derivatives() -> None:
    day, h = 9132.25, 0.5
    _, first, second = sun_direction(day)
    before, after = sun_direction(day - h), sun_direction(day + h)
    for lower, upper, rate in zip(before[:2], after[:2], (first, second), strict=True):
        quotient = (np.array(upper) - lower) / (2.0 * h * DAY)
        assert np.allclose(rate, quotient, rtol=0.0, atol=2e-5 * np.linalg.norm(rate))


def test_greenwich_at_the_epoch_of_the_default() -> None:
    assert math.degrees(earth_angle(days_of("epoch", "2025-01-01"))) == pytest.approx(
        100.89955, abs=1e-5
    )


def test_greenwich_turns_at_earths_rate() -> None:
    day = 9132.0
    turned = (earth_angle(day + 0.25) - earth_angle(day)) % math.tau
    assert turned == pytest.approx(EARTH_RATE * 0.25 * DAY % math.tau, abs=1e-6)


@pytest.mark.parametrize("zone", ["", "Z", "+00:00"])
def test_a_date_is_utc_with_and_without_its_zone(zone: str) -> None:
    # 2025-01-01 00:00 is 9131.5 days after 2000-01-01 12:00.
    assert days_of("epoch", f"2025-01-01T06:00:00{zone}") == 9131.75
    assert days_of("epoch", f"2025-01-01T06:00:00.500{zone}") == 9131.75 + 0.5 / DAY


@pytest.mark.parametrize("epoch", ["tomorrow", "Z", "2025-01-01T06:00:00+02:00Z", "1899-12-31"])
def test_no_date_is_refused(epoch: str) -> None:
    with pytest.raises(ConfigurationError, match=r"orbit\.epoch = '.*'; allowed: a date"):
        days_of("orbit.epoch", epoch)


def test_earths_shadow_is_the_truths() -> None:
    """The truth's own rounding is 5.4e-9, as computed once more with 40 digits."""
    truth = table("eclipse")
    craft, suns = columns(truth, "rx", "ry", "rz"), columns(truth, "sx", "sy", "sz")
    lit = [lit_fraction(tuple(r), tuple(sun)) for r, sun in zip(craft, suns, strict=True)]
    assert np.abs(lit - truth["lit"]).max() < 6e-9
    assert {0.0, 1.0} < set(lit)  # all of it, none of it, and parts
    # Beyond 1.4e9 m Earth is smaller than the Sun, and hides the middle of it.
    ring = 1.0 - (6378137.0 / 2e9 * (1.496e11 + 2e9) / 6.957e8) ** 2
    assert lit_fraction((-2e9, 0.0, 0.0), (1.496e11, 0.0, 0.0)) == pytest.approx(ring, rel=1e-5)
