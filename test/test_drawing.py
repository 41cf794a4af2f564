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

"""Lines thinned for drawing: light, and no spike lost."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ppc_attitude.analysis.drawing import (
    BUCKETS,
    DOTS,
    band,
    decimated,
    draw,
    legend,
    log_axis,
    panels,
    thinned,
    time_axis,
)


def test_a_long_gap_breaks_the_line_and_a_short_one_does_not():
    t = np.arange(100_000.0)
    values = np.cos(t)
    values[40_000:50_000] = np.nan
    values[7] = np.nan
    x, y = decimated(t, values)
    assert np.isnan(y[(x > 40_200) & (x < 49_800)]).all()
    assert np.isfinite(y[(x < 39_800) | (x > 50_200)]).all()


@settings(max_examples=60, deadline=None)
@given(n=st.integers(1, 20_000), seed=st.integers(0, 2**32 - 1), holes=st.floats(0, 1))
def test_what_is_kept(n, seed, holes):
    """Samples of the line, in order, with the first, the last and the extremes; all of a few."""
    random = np.random.default_rng(seed)
    values = random.normal(size=n)
    values[random.random(n) < holes] = np.nan
    x, y = decimated(np.arange(float(n)), values)
    assert (np.diff(x) >= 0).all()
    assert np.array_equal(values[x.astype(int)], y, equal_nan=True)
    assert (x[0], x[-1]) == (0.0, n - 1.0)
    assert x.size <= 2 * BUCKETS + 2
    assert x.size == n or n > 2 * BUCKETS
    if np.isfinite(values).any():
        assert np.nanmax(y) == np.nanmax(values)
        assert np.nanmin(y) == np.nanmin(values)


@settings(max_examples=40, deadline=None)
@given(n=st.integers(1, 40_000), seed=st.integers(0, 2**32 - 1), holes=st.floats(0, 1))
def test_a_cloud_of_dots_stays_light_and_loses_no_extreme(n, seed, holes):
    """Each of a day's 864 000 fixes was a dot: the report had half a gigabyte."""
    random = np.random.default_rng(seed)
    values = random.normal(size=n)
    values[random.random(n) < holes] = np.nan
    finite = np.isfinite(values)
    x, y = thinned(np.arange(float(n)), values)
    assert (np.diff(x) > 0).all()
    assert np.array_equal(values[x.astype(int)], y, equal_nan=True)
    assert x.size <= DOTS + 2
    assert finite.sum() > DOTS or np.array_equal(y[np.isfinite(y)], values[finite])
    if finite.any():
        assert (np.nanmin(y), np.nanmax(y)) == (np.nanmin(values), np.nanmax(values))
    # The others tell the spread of all: extremes alone would be twice as wide as it.
    assert holes > 0.5 or n < 20_000 or np.quantile(np.abs(y[np.isfinite(y)]), 0.1) < 0.6


@pytest.mark.parametrize(
    ("labels", "scale"),
    [
        (
            [
                "pointing: truth against reference",
                "control: estimate against reference",
                "knowledge: truth against estimate",
                "settled < 0.1 deg",
                "terminal < 0.05 deg",
            ],
            1.0,
        ),
        (["x", "y", "z", "limit ±0.004 N·m", "hit"], 4e-3),
        (["x", "y", "z", "limit ±4e+06 N·m", "hit"], 4e6),
    ],
)
def test_a_legend_stays_in_its_figure_and_off_the_factor_of_the_numbers(labels, scale):
    figure, (axes,) = panels(1)
    t = 200.0 * np.arange(3)
    for k, label in enumerate(labels):
        draw(axes, t, scale * np.arange(3.0) / (k + 1), label=label)
    time_axis(axes, t)
    axes.set_ylabel("attitude error, angle [deg]")
    legend(axes)
    figure.draw_without_rendering()
    box = axes.get_legend().get_window_extent()
    assert box.x1 <= figure.bbox.x1
    assert (scale == 1.0) == (not axes.yaxis.get_offset_text().get_text())
    if scale != 1.0:
        assert not box.overlaps(axes.yaxis.get_offset_text().get_window_extent())


@pytest.mark.parametrize(
    ("values", "told"),
    [((0.0, 2e-12), "×10⁻¹²"), ((0.0, 3e5), "×10⁵"), ((0.0, 3.0), ""), ((1e7, 1e7 + 1), "+1×10⁷")],
)
def test_what_the_numbers_of_an_axis_have_in_common_stands_beside_it(values, told):
    figure, (axes,) = panels(1)
    axes.plot(values, values)
    figure.draw_without_rendering()
    assert [axis.get_offset_text().get_text() for axis in (axes.xaxis, axes.yaxis)] == [told] * 2


def test_a_close_look_is_as_fine_as_the_record():
    _, (axes,) = panels(1)
    axes.set_xlim(1000.0, 1010.0)
    t = np.arange(360_001) / 100
    draw(axes, t, t)
    (line,) = axes.get_lines()
    assert np.array_equal(line.get_xdata(), t[99_999:101_002])


def test_a_noisy_line_becomes_a_band_and_a_smooth_one_does_not():
    t = np.arange(20_000) / 100
    noise = np.random.default_rng(1).normal(size=t.size)
    _, (axes,) = panels(1)
    draw(axes, t, np.sin(t) + noise)
    (low, high, line), (filled,) = axes.get_lines(), axes.collections
    assert (low.get_ydata() < line.get_ydata()).all() and (
        line.get_ydata() < high.get_ydata()
    ).all()
    extent = filled.get_datalim(axes.transData).extents
    assert extent[1] == (np.sin(t) + noise).min()
    assert np.abs(line.get_ydata() - np.sin(line.get_xdata())).mean() < 0.2  # of 34 samples each
    assert band(t, np.sin(t)) is None
    assert band(t, np.where(t > 100, 1.0, 0.0)) is None
    assert band(t[:100], noise[:100]) is None
    noise[-1] = 100.0
    _, _, _, high = band(t, noise)
    assert high[-1] == 100.0  # a spike at the end is none the less drawn


def test_a_band_beside_single_gaps_loses_no_extreme():
    """A lost message in a hundred blanked most of the line, and a spike beside one was gone."""
    t, noise = np.arange(12_001.0), np.random.default_rng(1).normal(size=12_001)
    whole = band(t, noise)
    noise[5005] = 50.0
    noise[::100] = np.nan
    noise[6000:7000] = np.nan
    found = band(t, noise)
    gap = (found[0] > 6010.0) & (found[0] < 6990.0)
    for each, same in zip(found[1:], whole[1:], strict=True):
        assert np.isnan(each[gap]).all()
        assert np.isfinite(each).mean() > 0.9
        assert np.median(np.abs(each - same)[~gap][np.isfinite(each[~gap])]) < 0.1
    assert np.nanmax(found[3]) == 50.0


def test_what_is_below_the_floor_turns_no_axis_upside_down():
    _, (axes,) = panels(1)
    draw(axes, np.arange(3.0), np.full(3, 1e-7))
    log_axis(axes, 1e-4)
    assert axes.get_ylim() == (1e-4, 1.0)
