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

"""Records of a correct filter, and of filters that are wrong in one way each."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from craft_helpers import configs
from synthetic import with_columns, with_rows, without_columns

from ppc_attitude.analysis.figures import figures_of
from ppc_attitude.analysis.measure import Measured
from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.verdict import NOT_JUDGED
from ppc_attitude.contract.run_record import Change, RunRecord
from ppc_attitude.science.estimators import mekf
from ppc_attitude.science.kinds import ESTIMATORS
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import load


def run(seconds: float = 40.0, **nodes: Mapping[str, Any]) -> RunRecord:
    files = configs("paper", "sensors_smallsat")
    given = {"spacecraft_plant": {"seed": 3}, **nodes}
    return simulate(load(files, given), seconds)


@cache
def correct() -> RunRecord:
    return run()


def rows(record: RunRecord) -> dict[str, Any]:
    return {each.key: each for each in Verdict(record).requirements}


def test_a_correct_filter_meets_its_requirements() -> None:
    found = rows(correct())
    for key in ("knowledge_outside", "nis", "refused_fixes", "lost_messages"):
        assert found[key].met is True, key


def test_one_run_does_not_condemn_the_knowledge_that_is_a_little_wrong() -> None:
    # A filter that believes itself three times better than it is.
    boastful = 0.1 * correct()["estimate"][:, 4:10]
    record = with_rows(correct(), "estimate", (slice(None), slice(4, 10)), boastful)
    row = rows(record)["knowledge_outside"]
    assert row.met is None
    assert "one run cannot tell" in row.reason


def test_a_filter_that_is_far_beyond_its_own_numbers_for_most_of_a_run_is_wrong() -> None:
    turned = {"star_tracker.mounting": [5e-4, 0.0, 0.0, 1.0]}  # by 1e-3 rad
    record = run(attitude_estimator=turned)
    row = rows(record)["knowledge_outside"]
    assert row.met is False
    assert row.value > 0.9
    # An error that is not known is in no share: of nine in ten, and of all.
    some = np.arange(record.t.size) % 10 > 0
    few, none = (with_rows(record, "truth_attitude", lost, np.nan) for lost in (some, slice(None)))
    assert rows(few)["knowledge_outside"].value > 0.9
    assert rows(none)["knowledge_outside"].value is None


def test_wrong_noise_numbers_show_in_the_innovations() -> None:
    timid = {"star_tracker.cross_noise": 5e-5, "star_tracker.boresight_noise": 3e-4}
    assert rows(run(attitude_estimator=timid))["nis"].met is False


def test_innovations_are_judged_by_how_sure_the_mean_of_so_many_is() -> None:
    fixes = np.isfinite(correct()["innovation"])
    nis = np.where(fixes, np.sqrt(4.0 / 3.0), np.nan)  # 4 each, of 3 expected
    found = rows(with_columns(correct(), innovation=nis))
    count = int(fixes[:, 0].sum())
    assert found["nis"].value == pytest.approx(1.0)
    # χ²₃ has a variance of 6.
    assert found["nis"].limit == pytest.approx(3.0 * np.sqrt(6.0 / count))
    assert found["refused_fixes"].limit == 1.0 > 1e-3 * count
    many = rows(with_columns(correct(), innovation=np.ones((correct().t.size, 3))))
    assert many["refused_fixes"].limit == pytest.approx(1e-3 * correct().t.size)


def test_a_gate_that_is_too_narrow_refuses_good_fixes() -> None:
    record = run(attitude_estimator={"gate": 4.0})
    row = rows(record)["refused_fixes"]
    # χ²_3 beyond 4: 26 % of the good fixes; they are good by the gate's own measure.
    assert row.value > 10.0 > row.limit
    assert row.met is False


def test_exact_fixes_that_are_refused_are_good_ones() -> None:
    exact = {"star_tracker.cross_noise": 0.0, "star_tracker.boresight_noise": 0.0}
    bias = {"gyro.initial_bias": [0.01, 0.0, 0.0]}  # much more than the filter believes
    assert rows(run(spacecraft_plant={**exact, **bias}))["refused_fixes"].value >= 1.0


def test_false_fixes_that_are_refused_are_no_good_ones() -> None:
    given = {"star_tracker.outlier_probability": 0.1, "star_tracker.outlier_size": 0.05}
    record = run(spacecraft_plant={"seed": 4, **given})
    assert rows(record)["refused_fixes"].value == 0.0
    refused = np.square(record["innovation"]).sum(axis=1) > 25.0
    assert refused.sum() > 20


def test_the_fix_from_which_a_filter_begins_anew_is_not_refused() -> None:
    given = {"star_tracker.outlier_probability": 0.3, "star_tracker.outlier_size": 0.3}
    record = run(spacecraft_plant={"seed": 2, **given})
    assert rows(record)["refused_fixes"].met is True


def test_knowledge_is_judged_without_any_innovation() -> None:
    blind = {"star_tracker.blinding_times": [0.05], "star_tracker.blinding_durations": [1e8]}
    found = rows(run(spacecraft_plant={"seed": 3, **blind}))
    assert found["knowledge_outside"].value is not None
    assert "nis" not in found


def test_refused_fixes_are_not_judged_without_the_fixes() -> None:
    row = rows(without_columns(correct(), "star_fix"))["refused_fixes"]
    assert (row.met, row.reason) == (None, "no topic star_tracker/attitude in the bag")


def test_refused_fixes_are_not_judged_without_the_mounting_of_the_tracker() -> None:
    given = correct().parameters
    known = {"gate": 0.5}  # of a filter that is not ours, or a bag that lost the rest
    record = replace(correct(), parameters={**given, "attitude_estimator": known})
    row = rows(record)["refused_fixes"]
    assert row.outcome == NOT_JUDGED
    assert row.reason == "no mounting (star_tracker.mounting of attitude_estimator) on record"


def test_innovations_are_not_judged_by_the_gate_of_a_filter_that_did_not_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    other = replace(mekf.COMPONENT, name="other", parameters=())
    monkeypatch.setitem(ESTIMATORS.components, "other", other)
    values = {**correct().parameters["attitude_estimator"], "estimator": "other"}
    found = rows(replace(correct(), parameters={"attitude_estimator": values}))
    assert "knowledge_outside" in found
    assert not {"nis", "refused_fixes"} & set(found)


def test_innovations_are_not_judged_by_a_gate_that_was_changed() -> None:
    record = replace(correct(), changes=(Change(10**9, "attitude_estimator", "gate", 0.5),))
    for key in ("nis", "refused_fixes"):
        row = rows(record)[key]
        assert (row.met, row.reason) == (None, "gate was changed in flight"), key


def test_the_figures_show_the_filters_errors_in_its_own_band() -> None:
    record = correct()
    figures = figures_of(Measured(record))
    lines = {axes.get_ylabel()[-10:-9]: axes.lines for axes in figures["knowledge_error"][1].axes}
    sigma = np.degrees(np.sqrt(record["estimate"][-1, [4, 7, 9]])) * 3600.0
    for axis, expected in zip("xyz", sigma, strict=True):
        error, low, high = (line.get_ydata()[-1] for line in lines[axis][:3])
        assert [low, high] == pytest.approx([-3.0 * expected, 3.0 * expected])
        assert low < error < high
    bias, low, high = (line.get_ydata()[-1] for line in figures["gyro_bias"][1].axes[2].lines[:3])
    assert bias == pytest.approx(np.degrees(record["gyro_bias"][-1, 2]))
    assert high - bias == pytest.approx(3.0 * np.degrees(record["gyro_bias_sigma"][-1, 2]))
    alone = figures_of(Measured(without_columns(record, "gyro_bias_sigma")))
    assert len(alone["gyro_bias"][1].axes) == 1
    top, bottom = figures["innovation"][1].axes
    told = np.isfinite(record["innovation"]).all(axis=1)
    drawn = np.asarray(bottom.lines[0].get_ydata())
    nis = np.square(record["innovation"][told]).sum(axis=1)
    assert np.array_equal(drawn[np.isfinite(drawn)], nis)
    assert bottom.lines[1].get_ydata()[0] == 25.0
    assert top.lines[3].get_ydata()[0] == 3.0


def test_an_error_far_beyond_its_band_is_in_view() -> None:
    record = correct()
    told = record["attitude"] + np.array([0.01, 0.0, 0.0, 0.0])  # 1.1°
    told /= np.linalg.norm(told, axis=1, keepdims=True)
    figures = figures_of(Measured(with_columns(record, attitude=told)))
    for axes in figures["knowledge_error"][1].axes:
        low, high = axes.get_ylim()
        assert low < axes.lines[0].get_ydata()[-1] < high


def test_a_run_too_short_says_so() -> None:
    row = rows(run(5.0))["knowledge_outside"]
    assert row.met is None
    assert "before the filter settles" in row.reason
