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
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.performance import (
    EnvelopeTable,
    clock_at,
    nearest,
    nominal,
    solve_envelope,
    widened_attitude_envelope,
    widened_rate_envelope,
)

TABLE_1 = EnvelopeTable(1.0, 1e-4, 0.05, 60.0, 5e-3)
TABLE_2_PRINTED = EnvelopeTable(0.08, 1e-6, 0.5, 40.0, 3e-5)
TABLE_2_REPAIRED = EnvelopeTable(0.08, 3e-5, 0.5, 40.0, 3e-5)
# The growth e^(l t2) of these is beyond any float.
FAST = EnvelopeTable(1.0, 0.01, 10.0, 100.0, 5e-3)
FASTER = EnvelopeTable(0.08, 3e-5, 20.0, 40.0, 2e-5)
FIELDS = ("initial", "exponential_terminal", "decay", "settling_time", "terminal")

tables = st.builds(
    lambda initial, asymptote, lt2, t2, terminal: EnvelopeTable(
        initial, asymptote * initial, lt2 / t2, t2, terminal * initial
    ),
    st.floats(1e-4, 10.0),
    st.floats(1e-6, 0.5),
    st.floats(0.2, 25.0),
    st.floats(1.0, 500.0),
    st.floats(1e-6, 0.6),
)


def is_feasible(table: EnvelopeTable) -> bool:
    try:
        solve_envelope("envelope", table)
    except ConfigurationError:
        return False
    return True


@pytest.mark.parametrize(
    ("table", "t1", "a1"),
    [
        pytest.param(TABLE_1, 20.547627909862406, 2.26797041865e-4, id="table 1"),
        # Two time constants before its end.
        pytest.param(TABLE_2_REPAIRED, 36.0, 0.07997 * math.exp(-18.0) / 16.0, id="table 2"),
        pytest.param(FAST, 1.14892940280188397, 5.12727751478108958e-7, id="fast for long"),
        pytest.param(FASTER, 0.747843117851019698, 6.50699962675103600e-9, id="faster for long"),
    ],
)
def test_the_joint_is_that_of_the_papers_condition(
    table: EnvelopeTable, t1: float, a1: float
) -> None:
    """As it was solved with 30 digits, or in closed form."""
    shape = solve_envelope("envelope", table)
    assert (shape["t1"], shape["curvature"]) == pytest.approx((t1, a1), rel=1e-11)
    before, after = (nominal(t, shape)[0] for t in (math.nextafter(t1, 0.0), t1))
    assert before == pytest.approx(after, abs=1e-12)


def test_table_2_as_printed_is_refused_with_its_number_and_remedies() -> None:
    with pytest.raises(ConfigurationError) as raised:
        solve_envelope("rate_envelope", TABLE_2_PRINTED)
    message = str(raised.value)
    assert "rate_envelope is infeasible" in message
    assert "r = " in message and "= 175875" in message
    assert "e/2 = 1.35914" in message
    for field in FIELDS:
        assert f"rate_envelope.{field} = " in message


BEYOND = {  # the side on which each number is infeasible when r is too large
    "initial": 0.999,
    "exponential_terminal": 0.999,
    "decay": 1.001,
    "settling_time": 1.001,
    "terminal": 1.001,
}


@pytest.mark.parametrize("table", [TABLE_2_PRINTED, EnvelopeTable(0.5, 0.01, 0.1, 40.0, 0.03)])
@pytest.mark.parametrize("field", FIELDS)
def test_nearest_value_is_feasible_and_a_little_beyond_is_not(
    field: str, table: EnvelopeTable
) -> None:
    values = nearest(table)
    assert set(values) == set(FIELDS)
    changed = vars(table) | {field: values[field]}
    assert is_feasible(EnvelopeTable(**changed))
    assert not is_feasible(EnvelopeTable(**(changed | {field: values[field] * BEYOND[field]})))


def test_too_short_a_time_names_the_shortest() -> None:
    table = EnvelopeTable(0.2, 1e-4, 0.05, 10.0, 5e-3)
    with pytest.raises(ConfigurationError, match=r"t1 < 0 with decay·settling_time = 0\.5"):
        solve_envelope("attitude_envelope", table)
    remedies = nearest(table)
    shortest, slowest, highest = (remedies[each] for each in ("settling_time", "decay", "terminal"))
    # t1 = 0 in the printed condition: l t2/2 − 1 + gap/A = 0.
    assert 0.5 * 0.05 * shortest - 1.0 + 4.9e-3 / 0.1999 == pytest.approx(0.0, abs=1e-5)
    assert slowest == pytest.approx(0.05 * shortest / 10.0, rel=1e-5)
    assert 0.25 - 1.0 + (highest - 1e-4) / 0.1999 == pytest.approx(0.0, abs=1e-5)
    assert is_feasible(replace(table, settling_time=shortest))
    assert not is_feasible(replace(table, settling_time=shortest * 0.999))


@pytest.mark.parametrize("field", ["decay", "settling_time"])
def test_a_parabola_shorter_than_the_digits_of_its_time_is_none(field: str) -> None:
    """Its length was zero, by which the curvature was divided."""
    table = replace(TABLE_2_REPAIRED, **{field: 1e30})
    shape, end = solve_envelope("envelope", table), table.settling_time
    for t in (shape["t1"], end, 2.0 * end):
        assert nominal(t, shape)[0] == pytest.approx(table.terminal, rel=1e-12)
    assert nominal(0.0, shape)[0] == pytest.approx(table.initial, rel=1e-12)


def test_what_no_parameter_may_be_is_no_remedy() -> None:
    assert "initial" not in nearest(replace(TABLE_1, decay=1000.0))
    assert "settling_time" not in nearest(replace(TABLE_1, decay=1e-30))


def test_an_envelope_must_fall() -> None:
    with pytest.raises(ConfigurationError, match=r"initial = 0.005 must be larger than"):
        solve_envelope("envelope", EnvelopeTable(5e-3, 1e-4, 0.05, 60.0, 5e-3))
    with pytest.raises(ConfigurationError, match=r"exponential_terminal = 2\.0 must be smaller"):
        solve_envelope("envelope", EnvelopeTable(1.0, 2.0, 0.05, 60.0, 5e-3))


def test_of_two_roots_the_larger_t1() -> None:
    decay, t2, r = 0.1, 40.0, 1.2
    table = EnvelopeTable(1.0, 0.01, decay, t2, 0.01 + r * 0.99 * math.exp(-decay * t2))
    grid = np.linspace(0.0, t2, 400_001)
    # The paper's first line of eq. 7, as printed (its k is l).
    condition = (0.5 * decay * (t2 - grid) - 1.0) * 0.99 * np.exp(-decay * grid) + (
        table.terminal - 0.01
    )
    roots = grid[:-1][np.diff(np.sign(condition)) != 0.0]
    assert roots.size == 2
    assert solve_envelope("envelope", table)["t1"] == pytest.approx(roots.max(), abs=2e-4)


@pytest.mark.parametrize("below", [0.0, 1e-12, 1e-9, 1e-6])
def test_where_the_two_roots_meet_the_joint_is_the_series(below: float) -> None:
    """At r = (1 − δ) e/2 the smaller root is x = 1 − p − p²/3 − 11 p³/72 − …, p = √(2 δ)."""
    decay, t2, asymptote = 0.3, 10.0, 1e-3
    amplitude = 1.0 - asymptote
    terminal = asymptote + 0.5 * math.e * (1.0 - below) * amplitude * math.exp(-decay * t2)
    t1 = solve_envelope("envelope", EnvelopeTable(1.0, asymptote, decay, t2, terminal))["t1"]
    p = math.sqrt(2.0 * below)
    x = 1.0 - p - p**2 / 3.0 - 11.0 / 72.0 * p**3
    # A rounding of r by 1e-16 moves the root by its square root where the two meet.
    assert decay * (t2 - t1) == pytest.approx(x, abs=1e-15 / max(p, 3e-8))


@given(tables)
def test_the_joint_is_where_lamberts_w_puts_it(table: EnvelopeTable) -> None:
    """l (t2 − t1) = 2 + W(−2 r e⁻²), by a W of 30 digits; of two roots that of the larger t1."""
    assume(table.terminal < table.initial and table.exponential_terminal < table.initial)
    assume(is_feasible(table))
    with mpmath.workdps(30):
        gap = mpmath.mpf(table.terminal) - mpmath.mpf(table.exponential_terminal)
        amplitude = mpmath.mpf(table.initial) - mpmath.mpf(table.exponential_terminal)
        width = mpmath.mpf(table.decay) * mpmath.mpf(table.settling_time)
        r = gap / amplitude * mpmath.exp(width)
        x = 2 + mpmath.lambertw(-2 * r * mpmath.exp(-2), -1 if r > 1 else 0).real
        # (1 − x/2) eˣ = r, so dx = 2 e⁻ˣ/(1 − x) dr; r is rounded in its exponent too.
        moved = 2.0 * mpmath.exp(-x) / abs(1 - x) * abs(r) * 1e-15 * (1 + width)
        t1 = max(table.settling_time - x / mpmath.mpf(table.decay), 0)
    found = solve_envelope("envelope", table)["t1"]
    assert abs(found - float(t1)) <= float(moved) / table.decay + 1e-14 * table.settling_time


@settings(max_examples=300)
@given(tables)
def test_feasible_envelopes_are_smooth_and_infeasible_ones_get_remedies(
    table: EnvelopeTable,
) -> None:
    assume(table.terminal < table.initial and table.exponential_terminal < table.initial)
    amplitude = table.initial - table.exponential_terminal
    if not is_feasible(table):
        remedies = nearest(table)
        assert remedies  # some number alone always helps
        for field, value in remedies.items():
            assert is_feasible(EnvelopeTable(**(vars(table) | {field: value})))
        return
    shape = solve_envelope("envelope", table)
    t1, a1, t2 = shape["t1"], shape["curvature"], table.settling_time
    assert 0.0 <= t1 < t2
    exponential = amplitude * math.exp(-table.decay * t1)

    def parabola(t: float) -> float:
        return a1 * (t - t2) ** 2 + table.terminal

    scale = max(table.terminal, exponential)
    assert parabola(t1) == pytest.approx(exponential + table.exponential_terminal, abs=1e-9 * scale)
    assert 2.0 * a1 * (t1 - t2) == pytest.approx(-table.decay * exponential, rel=1e-9)
    assert a1 > 0.0
    assert nominal(0.0, shape)[0] == pytest.approx(table.initial, rel=1e-12) or t1 == 0.0
    values = [nominal(t, shape)[0] for t in np.linspace(0.0, 1.2 * t2, 200)]
    assert np.all(np.diff(values) <= 0.0)
    assert nominal(t2, shape) == (table.terminal, 0.0)


@pytest.mark.parametrize("table", [TABLE_1, TABLE_2_REPAIRED])
def test_clock_inverts_the_envelope(table: EnvelopeTable) -> None:
    shape = solve_envelope("envelope", table)
    for t in np.linspace(0.0, 0.99 * table.settling_time, 41):
        assert nominal(clock_at(nominal(t, shape)[0], shape), shape)[0] == pytest.approx(
            nominal(t, shape)[0], rel=1e-9
        )
    assert clock_at(2.0 * table.initial, shape) == 0.0
    assert clock_at(0.5 * table.terminal, shape) == table.settling_time


DRIVE, DECAY = (0.02, 0.3, 0.0), 0.898


def test_rate_widening_solves_its_implicit_equation() -> None:
    delta, rho, h = (0.0, 2e-3, 1e-4), 3e-5, 0.01
    after = widened_rate_envelope(delta, rho, DRIVE, DECAY, h)
    for old, new, drive in zip(delta, after, DRIVE, strict=True):
        assert new >= 0.0
        assert new == pytest.approx(old + h * (-DECAY * new + drive / (rho + new)), rel=1e-10)


def test_attitude_widening_solves_its_implicit_equation() -> None:
    delta, h = (0.0, 0.1, 0.02), 0.01
    after = widened_attitude_envelope(delta, DRIVE, DECAY, h)
    for old, new, drive in zip(delta, after, DRIVE, strict=True):
        assert new == pytest.approx(old + h * (-DECAY * new + drive), rel=1e-12)
