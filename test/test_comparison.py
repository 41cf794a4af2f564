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

"""Figures of several runs and of the sweep."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import hit_run, normal_run, part_of, with_columns, without_columns

from ppc_attitude.analysis.comparison import (
    angular_velocity_comparison,
    attitude_comparison,
    comparisons_of,
    error_comparison,
    run_labels,
    sweep_figure,
)
from ppc_attitude.analysis.drawing import BLUE, RED, save
from ppc_attitude.analysis.envelopes import ATTITUDE, ENVELOPES, RATE, Envelope
from ppc_attitude.analysis.hits import SweptHit
from ppc_attitude.analysis.measure import Measured

LABELS = ["proposed", "benchmark"]


@pytest.fixture(scope="module")
def runs():
    one = normal_run(50.0, rate=10.0)
    envelope = np.full_like(one["attitude_envelope"], 0.7)
    return [one, with_columns(one, attitude_envelope=envelope)]


def measured(runs):
    return list(map(Measured, runs))


def lines(axes, colour):
    return [line for line in axes.get_lines() if line.get_color() == colour]


def test_the_first_is_red_and_the_second_blue_each_in_its_dotted_envelope(runs):
    axes = attitude_comparison(measured(runs), LABELS).axes
    assert len(axes) == 3
    for k, panel in enumerate(axes):
        for run, colour in zip(runs, (RED, BLUE), strict=True):
            state, upper, lower = lines(panel, colour)
            assert np.allclose(state.get_ydata(), run["attitude_error"][:, k], atol=1e-15)
            assert np.array_equal(upper.get_ydata(), run["attitude_envelope"][:, k])
            assert np.array_equal(lower.get_ydata(), -run["attitude_envelope"][:, k])
            assert state.get_linestyle() == "-"
            assert upper.get_linestyle() != "-"
        assert panel.get_ylabel() == f"pointing error\n$q_{{ev,{'xyz'[k]}}}$ [1]"
    told = [text.get_text() for text in axes[0].get_legend().get_texts()]
    assert told == ["proposed", "envelope", "benchmark"]


def test_the_rates_with_their_norm_and_the_limit(runs):
    axes = angular_velocity_comparison(measured(runs), LABELS).axes
    assert len(axes) == 4
    rate = np.rad2deg(runs[1]["angular_velocity"])
    assert np.array_equal(lines(axes[2], BLUE)[0].get_ydata(), rate[:, 2])
    assert np.allclose(lines(axes[3], RED)[0].get_ydata(), np.linalg.norm(rate, axis=1))
    limits = [line for line in axes[3].get_lines() if set(line.get_ydata()) == {3.0}]
    assert [line.get_color() for line in limits] == [RED, BLUE]
    assert all("deg/s" in each.get_ylabel() for each in axes)


def test_a_late_hit_of_any_run_is_shown_closely():
    runs = [hit_run(), normal_run()]
    axes = attitude_comparison(measured(runs), LABELS).axes
    assert len(axes) == 6
    assert [each.get_xlim() for each in axes[1::2]] == [(78.0, 92.0)] * 3
    bound = runs[0]["attitude_envelope"][7800:9201].max()
    assert axes[1].get_ylim()[1] == pytest.approx(1.1 * bound, rel=1e-12)


def test_rate_errors_are_compared_where_both_have_envelopes(runs):
    names = [f"comparison_{of}" for of in ("attitude_error", "angular_velocity", "rate_error")]
    drawn, lacking = comparisons_of(measured(runs))
    assert (list(drawn), lacking) == (names, [])
    plain = [runs[0], without_columns(runs[1], "rate_envelope")]
    drawn, lacking = comparisons_of(measured(plain))
    assert list(drawn) == names[:2]
    why = "the record has no sample of 'control/rate_envelope'"
    assert lacking == [f"comparison_rate_error is not drawn: {plain[1].source}: {why}"]
    other = replace(plain[1], controller="log_barrier", parameters={})
    _, (lacks,) = comparisons_of(measured([runs[0], other]))
    assert lacks.endswith(f"{other.source}: no component bounds the rate error")
    panel = error_comparison(measured(runs), LABELS, ENVELOPES[1]).axes[0]
    assert panel.get_yscale() == "log"
    z2 = np.rad2deg(np.abs(runs[0]["rate_error"][:, 0]))
    assert np.array_equal(lines(panel, RED)[0].get_ydata(), z2)


def test_a_name_of_a_bag_is_no_mathematics_and_none_is_hidden(runs):
    named = [replace(runs[0], source=name) for name in (r"$\frac{$", "_mine")]
    drawn, _ = comparisons_of(measured(named))
    _, figure = drawn["comparison_attitude_error"]
    figure.canvas.draw()
    told = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert {r"\$\frac{\$", "\u200b_mine"} <= set(told)


def test_an_error_of_one_number_has_one_row():
    """As of a component of somebody else's, whose envelope may have less numbers too."""
    narrow = [with_columns(run, rate_error=run["rate_error"][:, :1]) for run in (hit_run(),) * 2]
    narrow = [with_columns(run, rate_envelope=run["rate_envelope"][:, :1]) for run in narrow]
    assert len(error_comparison(measured(narrow), LABELS, ENVELOPES[1]).axes) == 2
    narrow[0] = with_columns(narrow[0], attitude_envelope=narrow[0]["attitude_envelope"][:, :1])
    rows = attitude_comparison(measured(narrow), LABELS).axes[::2]
    dotted = [
        len([each for each in lines(axes, RED) if each.get_linestyle() != "-"]) for axes in rows
    ]
    assert dotted == [2, 0, 0]


def test_no_part_of_a_run_is_hidden_by_another_that_was_recorded_late():
    whole = normal_run(30.0)
    late = part_of(whole, slice(1000, None))
    figure = attitude_comparison(measured([normal_run(20.0), late]), LABELS)
    assert figure.axes[0].get_xlim() == (0.0, 30.0)


@pytest.mark.parametrize(
    ("controllers", "sources", "labels"),
    [
        (["ppc", "log_barrier"], ["a", "b"], ["ppc", "log_barrier"]),
        (["ppc", "ppc"], ["x/a", "x/b"], ["a", "b"]),
        (["ppc", "ppc"], ["x/a", "y/a"], ["a (1)", "a (2)"]),
    ],
)
def test_labels(controllers, sources, labels):
    run = normal_run(0.0)
    runs = [replace(run, controller=c, source=s) for c, s in zip(controllers, sources, strict=True)]
    assert run_labels(runs) == labels


def test_a_sweep_draws_each_envelope_that_a_hit_leaves_and_no_other():
    momentum = Envelope("momentum_error", "momentum_tube")
    hits = [SweptHit(0.1, 1.0, {ATTITUDE: 0.5, momentum: 0.2}, settled=True)]
    _, bottom = sweep_figure(hits).axes
    assert bottom.get_ylabel() == "momentum error outside\nits envelope [s]"
    assert list(bottom.get_lines()[0].get_ydata()) == [0.2]
    (alone,) = sweep_figure([SweptHit(0.1, 1.0, {ATTITUDE: 0.5}, settled=True)]).axes
    told = [text.get_text() for text in alone.get_legend().get_texts()]
    assert told == ["recovery", "limit 10 s"]  # nothing that is not recovered


def test_the_sweep(tmp_path):
    durations = [0.05, 0.1, 0.2, 0.5, 1.0]
    recovery = [2.0, None, 12.0, 3.5, None]
    outside = [0.1, 0.2, 0.4, 2.0, 5.0]
    each = zip(durations, recovery, outside, strict=True)
    hits = [SweptHit(lasts, after, {RATE: out}, settled=True) for lasts, after, out in each]
    top, bottom = sweep_figure(hits).axes
    by_label = {line.get_label(): line for line in top.get_lines()}
    broken = [2.0, np.nan, 12.0, 3.5, np.nan]  # nothing is known between its neighbours
    assert np.array_equal(by_label["recovery"].get_ydata(), broken, equal_nan=True)
    assert list(by_label["not recovered"].get_xdata()) == [0.1, 1.0]
    assert by_label["limit 10 s"].get_ydata()[0] == 10.0
    assert list(bottom.get_lines()[0].get_ydata()) == outside
    ticks = [text.get_text() for text in bottom.get_xticklabels()]
    assert ticks == ["0.05", "0.1", "0.2", "0.5", "1"]
    assert bottom.get_xlabel() == "duration of the hit [s]"
    assert top.get_ylabel() == "recovery time [s]"
    path = tmp_path / "figures" / "sweep.png"
    save(sweep_figure(hits), path)
    assert path.read_bytes().startswith(b"\x89PNG")

    sweep_figure([hits[1]]).draw_without_rendering()  # also without a single recovery
