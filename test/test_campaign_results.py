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

"""What a campaign comes to: errors over time, shares with intervals, figures, report, command."""

import math
import os
import re
import shlex
import signal
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from campaign_helpers import RUNS, VARIES, compute_here, finish, rows_of, small
from conftest import Ask, StartProcess
from craft_helpers import ROOT, overlay
from docs_helpers import described, table
from process_helpers import COMMAND, Process, alive, until, workers_of
from scipy import stats
from synthetic import normal_run

from ppc_attitude.analysis.requirements import PAPER, names_of
from ppc_attitude.analysis.truth import pointing_errors
from ppc_attitude.campaign import rows
from ppc_attitude.campaign.campaign import Finished
from ppc_attitude.campaign.figures import bands_figure, failing_figure, telling_variables
from ppc_attitude.campaign.quantile_bands import (
    EDGES,
    QUANTITIES,
    UNKNOWN,
    QuantileBands,
    levels_of,
    time_bins,
)
from ppc_attitude.campaign.report import write_campaign_report
from ppc_attitude.campaign.results import FAN_FILE
from ppc_attitude.campaign.summary import WORST, Fraction, Summary, Tally
from ppc_attitude.campaign.variables import DRAWN
from ppc_attitude.command_line.commands.campaign import _exit_code
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.processes.exits import RunError


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    return finish(tmp_path_factory.mktemp("c") / "one")


def test_levels_hold_the_largest_value_of_their_bin() -> None:
    record = normal_run(120.0)
    starts, ends = time_bins(record.stamps_ns)
    levels = levels_of(record, pointing_errors(record).sizes)
    t, error = record.stamps_ns * 1e-9, pointing_errors(record).sizes
    bounds = np.concatenate([[0.0], EDGES, [np.inf]])
    for k in range(starts.size):
        last = ends[k + 1] if k + 1 < starts.size else np.inf
        peak = error[(t >= ends[k]) & (t < last)].max()
        assert bounds[levels[0, k]] <= peak < bounds[levels[0, k] + 1]


def test_a_bin_with_a_hole_is_unknown() -> None:
    record = normal_run(120.0)
    sizes = pointing_errors(record).sizes.copy()
    sizes[6000] = np.nan
    starts, _ = time_bins(record.stamps_ns)
    unknown = np.flatnonzero(levels_of(record, sizes)[0] == UNKNOWN)
    assert unknown.tolist() == [np.searchsorted(starts, 6000, "right") - 1]


@pytest.mark.filterwarnings("error")
def test_there_is_no_envelope_before_the_first_estimate() -> None:
    record = normal_run(120.0)
    for name in ("attitude_error", "attitude_envelope"):
        record.columns[name] = record.columns[name].copy()
        record.columns[name][:3] = 0.0
    levels = levels_of(record, pointing_errors(record).sizes)
    assert (levels[1:, 0] == UNKNOWN).all()
    assert (levels[:, 1:] != UNKNOWN).all() and levels[0, 0] != UNKNOWN


def bands_of(values: np.ndarray) -> QuantileBands:
    """Bands of one time bin in which the runs have these attitude errors."""
    bands = QuantileBands(np.array([0.0, 1.0]))
    for value in values:
        level = np.full((len(QUANTITIES), 1), UNKNOWN, np.uint8)
        level[0] = np.searchsorted(EDGES, value, "right")
        bands.add(level)
    return bands


@pytest.mark.parametrize("share", [0.0, 0.05, 0.25, 0.5, 0.95, 1.0])
def test_quantiles_are_true_to_a_level(share: float) -> None:
    values = np.exp(np.random.default_rng(2).normal(-6.0, 1.0, 5000))
    bands = bands_of(values)
    (found,) = bands.quantiles("attitude_error", share)
    assert abs(math.log10(found / np.quantile(values, share))) <= 1 / 32 + 1e-9
    assert np.isnan(bands.quantiles("normalised_error", share)).all()  # which no run had


@pytest.mark.parametrize(("met", "judged"), [(0, 10), (3, 7), (50, 50), (9990, 10000)])
def test_interval_is_wilsons(met: int, judged: int) -> None:
    """Its ends p are where |met/judged − p| is 1.96 of its standard deviations √(p(1 − p)/n)."""
    share, z = met / judged, stats.norm.ppf(0.975)
    for end in Fraction(met, judged).interval:
        off = z**2 * end * (1.0 - end) / judged
        assert (share - end) ** 2 == pytest.approx(off, rel=1e-9, abs=1e-15)


def test_nothing_judged_is_nothing_known() -> None:
    assert Fraction(0, 0).interval == (0.0, 1.0)
    assert Fraction(0, 0).to_json()["fraction"] is None


def test_summary_counts_what_the_rows_say(finished: Finished) -> None:
    kept = rows_of(finished.folder)
    summary = finished.summary
    assert summary.runs == RUNS
    assert summary.all_met == sum(row["all_met"] for row in kept)
    for name, tally in summary.requirements():
        (key,) = [key for key, known in names_of(PAPER).items() if known == name]
        judged = [row for row in kept if row[f"met_{key}"] is not None]
        assert tally.fraction == Fraction(sum(row[f"met_{key}"] for row in judged), len(judged))
        values = [(row[f"value_{key}"], row["index"]) for row in judged]
        size = [(math.inf if value is None else value, -index) for value, index in values]
        worst = sorted(size, reverse=True)[:WORST]
        open_rows = [row for row in kept if row[f"met_{key}"] is None and row[f"note_{key}"]]
        assert tally.not_judged == len(open_rows)
        assert tally.worst_runs() == [(-index, value) for value, index in worst]
        (told,) = [each for each in summary.to_json()["requirements"] if each["name"] == name]
        assert [each["value"] for each in told["worst"]] == [value for value, _ in worst]


def test_every_column_of_the_files_is_described(finished: Finished) -> None:
    page = ROOT / "docs/reference.md"
    told = {row[0].partition("`")[0] for row in table(page, "| column of `runs.parquet` |")}
    columns = rows_of(finished.folder)[0].keys() - {*DRAWN, *rows.METRICS}
    parts = "|".join(rows.PARTS)
    named = {re.sub(f"^({parts})_.*", r"\1_KEY", name) for name in columns}
    assert told == named | {"initial_attitude_x", "settling_time_s"}
    bands = pq.read_schema(finished.folder / FAN_FILE).names
    assert [row[0] for row in table(page, "| column of `error_over_time.parquet` |")] == bands


def test_of_runs_with_limits_of_their_own_those_that_miss_are_the_worst() -> None:
    """Of runs with tanks of random size five were listed that had fuel left, and none without."""
    tally = Tally()
    for index, tank in enumerate((0.5, 0.001, 0.4, 0.002, 0.3, 0.6)):
        used = min(tank, 0.004)
        tally.add(used < tank, used, f"< {tank} kg", index)
    assert tally.worst_runs()[:3] == [(3, 0.002), (1, 0.001), (0, 0.004)]


def test_a_limit_is_told_where_no_run_is_judged_by_it() -> None:
    tally = Tally()
    tally.add(None, None, "< 0.0005", 0)
    assert (tally.limit_text, tally.not_judged) == ("< 0.0005", 1)


def test_a_broken_run_meets_nothing() -> None:
    """And whoever reads the share is told."""
    summary = Summary(PAPER, {})
    summary.add(rows.broken(small(), 4, "lost", {}).row | {"fault": "dead"})
    summary.add(dict.fromkeys(rows.row_types(small())) | {"all_met": True, "fault": "dead"})
    assert [str(share) for _, share in summary.shares()] == [
        "50.00 % (9.45 … 90.55); broken and counted as missed: 1"
    ] * 2
    told = summary.to_json()
    for share in (told["all_requirements"], told["faults"]["dead"]):
        assert (share["met"], share["judged"], share["broken"]) == (1, 2, 1)
    assert summary.first_broken == (4, "lost")
    assert summary.requirements() == []


@pytest.mark.parametrize(("end", "drawn"), [(50.0, 0), (79.0, 1), (80.0, 2)])
def test_accuracies_are_drawn_where_runs_are_judged_by_them(end: float, drawn: int) -> None:
    bands = QuantileBands(np.linspace(0.0, end, 81))
    labels = bands_figure(bands).axes[0].get_legend_handles_labels()[1]
    assert len({"settled < 0.005", "terminal < 0.0005"} & set(labels)) == drawn


@pytest.mark.filterwarnings("error")
def test_variables_that_decide_come_first() -> None:
    own = np.random.default_rng(4)
    runs = [{"inertia_error": own.random(), "rate_noise": own.random()} for _ in range(400)]
    for run in runs:
        run["actuator_strength"] = 1.0  # does not vary
    good = [run for run in runs if run["rate_noise"] < 0.6]
    bad = [run for run in runs if run["rate_noise"] >= 0.6]
    assert telling_variables(good, bad, DRAWN) == ["rate_noise", "inertia_error"]
    assert telling_variables([], bad, DRAWN) != []
    assert len(telling_variables(good[:1], bad[:1], DRAWN)) == 2  # and no warning
    assert failing_figure([], [], DRAWN) is None
    figure = failing_figure(good, bad, DRAWN)  # over the two that vary
    assert figure is not None
    assert len(figure.axes) == 1
    for run in runs:
        run["rate_noise"] **= 9.0
        run["inertia_error"] **= 9.0
        run["inertia_error"] -= 0.1
    figure = failing_figure(good, bad, DRAWN)
    assert figure is not None
    (axes,) = figure.axes  # of numbers that crowd near zero, where they are positive
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "linear")


def test_figures_show_what_they_are_given(finished: Finished) -> None:
    top, bottom = bands_figure(finished.bands).axes
    (median,) = [line for line in top.lines if line.get_label() == "median"]
    np.testing.assert_array_equal(
        median.get_ydata(), finished.bands.quantiles("attitude_error", 0.5)
    )
    assert len(bottom.collections) == 3
    summary = finished.summary
    figure = failing_figure(summary.passing, summary.failing, DRAWN)
    assert figure is not None
    for axes in figure.axes:
        points = sum(len(each.get_offsets()) for each in axes.collections)
        assert points == RUNS


@pytest.mark.usefixtures("undrawn")
def test_report_says_how_to_run_the_worst_again(finished: Finished, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_campaign_report(small(), finished, ["ppc_attitude", "campaign", "--seed", "1"], path)
    page = path.read_text(encoding="utf-8")
    summary = finished.summary
    assert f"{summary.all_met} of {RUNS} runs meet every requirement" in page
    for name, tally in summary.requirements():
        assert name in page
        if tally.met < tally.judged:
            worst, _ = tally.worst_runs()[0]
            assert f"ppc_attitude campaign --seed 1 --only {worst}" in page
    assert page.count("<img") == 2
    assert "distribution: cone" in page
    assert '<span class="open">–</span>' in page  # of what no run was judged by
    assert "stopped before its end" not in page
    stopped = replace(finished, total=RUNS + 1)
    write_campaign_report(small(), stopped, ["ppc_attitude", "campaign"], path)
    page = path.read_text(encoding="utf-8")
    assert "The campaign was stopped before its end." in page
    broken = Summary(PAPER, {})
    broken.add(rows.broken(small(), 4, "<lost>", {}).row)
    ended = replace(finished, total=1, summary=broken)
    write_campaign_report(small(), ended, ["ppc_attitude", "campaign"], path)
    assert "1 runs broke and were not judged; they count as" in path.read_text(encoding="utf-8")
    with pytest.raises(RunError, match="1 runs broke; the first, run 4: <lost>"):
        _exit_code(ended)
    assert f"{RUNS} of {RUNS + 1}, " in page


def written(tmp_path: Path) -> list[str]:
    """Files of a small campaign, as arguments."""
    config = overlay(tmp_path / "config.yaml", {PLANT: {"duration": 3.0, "rate": 50.0}})
    declared = tmp_path / "campaign.yaml"
    declared.write_text(yaml.safe_dump({"campaign": VARIES}), encoding="utf-8")
    return ["campaign", "--config", str(config), "--campaign", str(declared), "--seed", "1"]


@pytest.mark.usefixtures("undrawn")
def test_command_gives_the_campaign(
    finished: Finished, tmp_path: Path, ask: Ask, monkeypatch: pytest.MonkeyPatch
) -> None:
    compute_here(monkeypatch)
    out, report = tmp_path / "out", tmp_path / "report.html"
    options = ["--runs", RUNS, "--out", out, "--report", report, "--json"]
    told = ask(*written(tmp_path), *options).json  # runs this short show little
    assert list(told) == described("campaign")
    assert told["done"] == told["runs"] == RUNS
    assert told["requirements"] == finished.summary.to_json()["requirements"]
    assert rows_of(out) == rows_of(finished.folder)
    assert report.exists()


@pytest.mark.usefixtures("undrawn")
def test_command_runs_one_again(
    finished: Finished, tmp_path: Path, ask: Ask, monkeypatch: pytest.MonkeyPatch
) -> None:
    compute_here(monkeypatch)
    slow, report = tmp_path / "slow.yaml", tmp_path / "report.html"
    slow.write_text("rate: 0.01\n", encoding="utf-8")
    given = written(tmp_path)
    options = ["--requirements", slow, "--runs", 1, "--out", tmp_path / "out", "--report", report]
    ask(*given, *options, code=1)
    page = report.read_text(encoding="utf-8")
    _, *command = shlex.split(unescape(page.split("<code>")[1].split("</code>")[0]))
    ask(*command, code=1)
    told = ask(*given, "--only", 9, "--json").json
    row = rows_of(finished.folder)[9]
    for name in ("max_rate_deg_s", "max_applied_torque", "settling_time_s"):
        assert told["metrics"][name] == row[name]
    assert told["drawn"]["pulse_torque"] == row["pulse_torque"]


def test_ctrl_c_ends_all_workers_and_keeps_what_is_done(
    tmp_path: Path, start_process: StartProcess
) -> None:
    out = tmp_path / "out"
    command = [*COMMAND, *written(tmp_path), "--runs", "1000000", "--workers", "2"]
    command += ["--out", str(out)]
    campaign = Process(start_process, tmp_path, "campaign", command, cwd=ROOT)
    until(lambda: re.search(r" [1-9]\d*/1000000", campaign.err), "its bar to move")
    # A copy has its name later than its life, and the first may have answered by then.
    workers = until(lambda: len(found := workers_of(campaign.pid)) == 2 and found, "both workers")
    os.killpg(campaign.pid, signal.SIGINT)  # as a terminal does it: to all of them
    assert campaign.ends() == 3
    assert not any(map(alive, workers))
    assert "Traceback" not in campaign.err
    done = len(rows_of(out))
    assert done > 0
    assert f"error: interrupted after {done} of 1000000 runs; {out} holds them" in campaign.err
