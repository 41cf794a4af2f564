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

"""A campaign gives the same results whoever computes, loses none, and tells what they come to."""

import errno
import json
import os
import signal
import threading
from collections import Counter
from concurrent.futures import Future
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from campaign_helpers import (
    RUNS,
    VARIES,
    PoolHere,
    compute_here,
    files_of,
    finish,
    rows_of,
    run_one,
    small,
)
from process_helpers import workers_of

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.requirements import PAPER, Requirements, names_of
from ppc_attitude.analysis.truth import pointing_errors
from ppc_attitude.campaign import results, rows
from ppc_attitude.campaign.campaign import Finished, outcomes, run_campaign
from ppc_attitude.campaign.declaration import Campaign, campaign, draw, scenario_of_run
from ppc_attitude.campaign.pools import WorkerLostError
from ppc_attitude.campaign.quantile_bands import QUANTITIES
from ppc_attitude.campaign.rows import CampaignError, Outcome, rerun, row_types, run_chunk
from ppc_attitude.campaign.variables import varying
from ppc_attitude.contract.topics import PLANT, REFERENCE
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import scenario


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    return finish(tmp_path_factory.mktemp("c") / "one")


# One run


def test_a_run_is_that_of_its_scenario() -> None:
    of = small()
    verdict = Verdict(simulate(scenario_of_run(of, 7), of.duration))
    row = run_one(of, 7).row
    assert row["index"] == 7
    assert row["error"] is None
    for each in verdict.requirements:
        key = each.key
        assert (row[f"met_{key}"], row[f"value_{key}"]) == (each.met, each.value)
        assert (row[f"limit_{key}"], row[f"note_{key}"]) == (each.limit_text, each.note)
    applied = {each.key for each in verdict.requirements}
    assert all(row[f"note_{key}"] is None for key in names_of(PAPER) if key not in applied)
    assert row["max_rate_deg_s"] == verdict.metrics.max_rate_deg_s
    assert row["all_met"] == verdict.all_met
    names = varying(of.variables)
    assert {name: row[name] for name in names} == {name: draw(of, 7)[name] for name in names}
    again = rerun(of, 7)
    assert again.requirements == verdict.requirements
    assert again.record.source == "campaign run 7"


def test_a_row_tells_the_recovery_from_the_hit_that_was_drawn() -> None:
    varied = {
        "initial_attitude": {"distribution": "cone", "angle": 1e-4},
        "disturbance": {"time": 1.0, "duration": 0.1, "torque": 0.3},
    }
    of = campaign(varied, scenario({PLANT: {"duration": 60.0, "rate": 50.0}}), 1)
    (hit,) = rerun(of, 0).metrics.disturbances
    assert hit.recovery_time_s is not None
    assert run_one(of, 0).row["recovery_time_s"] == hit.recovery_time_s


def test_goals_and_cones_of_the_scenario_are_those_of_every_run() -> None:
    reference = {
        "mode": "goal",
        "goals.times": [1.0],
        "goals.attitudes": [0.6, 0.0, 0.0, 0.8],
        "keep_out.axes": [0.0, 0.0, 1.0],
        "keep_out.half_angles": [0.2],
    }
    plant = {"duration": 6.0, "rate": 20.0}
    turns = {name: VARIES[name] for name in ("initial_attitude", "attitude_noise")}
    of = campaign(turns, scenario({REFERENCE: reference, PLANT: plant}), 1)
    found = [run_one(of, index).row for index in range(3)]
    assert [row["error"] for row in found] == [None] * 3
    assert len({row["value_keep_out"] for row in found}) == 3
    assert all(row["initial_error_angle"] < 1e-12 for row in found)
    assert all(row["max_rate_deg_s"] > 1.0 for row in found)  # a slew has begun


def test_every_requirement_has_its_columns() -> None:
    own = Requirements(limits={"applied_torque": 0.01})
    for required in (PAPER, own):
        of = replace(small(), required=required)
        columns = row_types(of)
        assert set(run_one(of, 0).row) == set(columns)
        assert {f"met_{key}" for key in names_of(required)} <= set(columns)
    row = run_one(replace(small(), required=own), 0).row
    assert (row["met_limit_applied_torque"], row["all_met"]) == (False, False)


def test_a_run_does_not_depend_on_those_before_it() -> None:
    of = small()
    alone = [run_one(of, index) for index in (5, 3, 4)]
    together = run_chunk(of, 3, 6)
    for outcome in alone:
        other = together[outcome.row["index"] - 3]
        assert outcome.row == other.row
        assert np.array_equal(outcome.levels, other.levels)


def test_a_run_that_raises_becomes_a_row_that_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any) -> Any:
        raise ZeroDivisionError("of all things")

    monkeypatch.setattr(rows, "Verdict", fail)
    outcome = run_one(small(), 3)
    assert outcome.row["error"] == "ZeroDivisionError: of all things"
    assert outcome.row["index"] == 3
    assert outcome.row["pulse_torque"] == draw(small(), 3)["pulse_torque"]
    assert outcome.row["all_met"] is None
    assert outcome.levels is None


@pytest.mark.parametrize("package", ["numpy", "of_a_law"])
def test_a_worker_with_other_versions_refuses(package: str) -> None:
    of = small()
    foreign = Campaign(of.scenario, of.variables, of.seed, {}, {**of.made_with, package: "1.0"})
    with pytest.raises(CampaignError, match=rf"other versions .*: {package} .* there, 1\.0 here"):
        run_chunk(foreign, 0, 1)


# Many runs


def test_files_hold_every_run_in_order(finished: Finished) -> None:
    table = pq.read_table(finished.folder / "runs.parquet")
    assert table.column_names == list(row_types(small()))
    assert table["index"].to_pylist() == list(range(RUNS))
    assert rows_of(finished.folder)[11] == run_one(small(), 11).row
    kept = json.loads(table.schema.metadata[b"ppc_attitude"])
    assert kept["seed"] == 1
    assert kept["campaign"] == VARIES
    assert kept["parameters"]["spacecraft_plant"]["rate"] == 50.0
    assert "numba" in kept["versions"]


def test_error_over_time_counts_every_run_in_every_bin(finished: Finished) -> None:
    kept = pq.read_table(finished.folder / "error_over_time.parquet").to_pylist()
    counts = Counter[tuple[str, float]]()
    for each in kept:
        counts[each["quantity"], each["from_s"]] += each["runs"]
    assert set(counts.values()) == {RUNS}
    assert len(counts) == len(QUANTITIES) * finished.bands.counts.shape[1]
    at_start = [e for e in kept if e["quantity"] == "attitude_error" and e["from_s"] == 0.0]
    for index in range(RUNS):
        error = np.abs(pointing_errors(rerun(small(), index).record).quaternions[0, :3]).max()
        assert any(each["low"] <= error < each["high"] for each in at_start)


def test_no_worker_begins_without_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = list[int]()

    def pool(of: Campaign, workers: int) -> PoolHere:
        asked.append(workers)
        return PoolHere(of)

    monkeypatch.setattr("ppc_attitude.campaign.campaign.LocalPool", pool)
    run_campaign(small(), 2, tmp_path / "c", workers=500)
    assert asked == [2]


def test_a_killed_worker_and_the_number_of_workers_change_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    of, runs = small(duration=6.0, rate=100.0), 64
    victims: list[int] = []

    def kill_one(done: int) -> None:
        if not victims:
            victims.append(workers_of(os.getpid())[0])
            os.kill(victims[0], signal.SIGKILL)

    run_campaign(of, runs, tmp_path / "hurt", workers=2, progress=kill_one)
    compute_here(monkeypatch)
    run_campaign(of, runs, tmp_path / "whole")
    assert len(victims) == 1
    assert files_of(tmp_path / "hurt") == files_of(tmp_path / "whole")


class FragilePool(PoolHere):
    """A chunk that holds the deadly run loses its worker."""

    slots = 2

    def __init__(self, of: Campaign, deadly: int = -1, fatal: Exception | None = None) -> None:
        super().__init__(of)
        self.deadly, self.fatal, self.submitted = deadly, fatal, 0

    def submit(self, start: int, stop: int) -> "Future[list[Outcome]]":
        self.submitted += 1
        if not start <= self.deadly < stop:
            return super().submit(start, stop)
        future: Future[list[Outcome]] = Future()
        future.set_exception(self.fatal or WorkerLostError("gone"))
        return future


class SilentPool(FragilePool):
    """Forgets what it was given, and knows it."""

    def submit(self, start: int, stop: int) -> "Future[list[Outcome]]":
        return Future()

    def check(self) -> None:
        raise CampaignError("the scheduler was lost")


def test_a_pool_that_forgets_its_work_ends_the_campaign() -> None:
    with pytest.raises(CampaignError, match="the scheduler was lost"):
        list(outcomes(small(), 24, SilentPool(small()), threading.Event()))


def test_a_run_that_kills_its_workers_is_the_only_one_lost() -> None:
    found = list(outcomes(small(), 24, FragilePool(small(), deadly=17), threading.Event()))
    assert [each.row["index"] for each in found] == list(range(24))
    broken = [each.row for each in found if each.row["error"] is not None]
    assert [row["index"] for row in broken] == [17]
    assert "every worker that ran it was lost" in broken[0]["error"]
    assert draw(small(), 17).items() <= broken[0].items()  # so it counts for the fault it drew


def test_what_is_wrong_with_the_campaign_ends_it() -> None:
    pool = FragilePool(small(), deadly=17, fatal=CampaignError("other versions"))
    with pytest.raises(CampaignError, match="other versions"):
        list(outcomes(small(), 24, pool, threading.Event()))


def test_no_more_is_submitted_than_can_be_held(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ppc_attitude.campaign.campaign.LARGEST_CHUNK", 1)
    pool = FragilePool(small(0.1))
    stream = outcomes(small(0.1), 10**9, pool, threading.Event())
    next(stream)
    assert pool.submitted <= 8
    stream.close()


def test_a_stopped_campaign_keeps_what_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compute_here(monkeypatch)
    stop = threading.Event()

    def at_thirty(done: int) -> None:
        if done >= 30:
            stop.set()

    cut = run_campaign(
        small(),
        2000,
        tmp_path / "c",
        progress=at_thirty,
        stopping=lambda: nullcontext(stop),
    )
    kept = rows_of(tmp_path / "c")
    assert 30 <= cut.summary.runs == len(kept) < 2000
    assert [row["index"] for row in kept] == sorted({row["index"] for row in kept})
    assert kept[29] == run_one(small(), 29).row


def test_a_broken_progress_leaves_whole_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compute_here(monkeypatch)

    def interrupt(done: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_campaign(small(), 50, tmp_path / "c", progress=interrupt)
    assert [row["index"] for row in rows_of(tmp_path / "c")] == [0]


def test_a_full_disk_is_named_and_leaves_no_table_that_cannot_be_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The table was ended after what had failed, and that error took the place of the first."""
    monkeypatch.setattr(results, "BATCH", 10)
    compute_here(monkeypatch)
    raised = [OSError(errno.ENOSPC, "No space left"), ValueError("Operation on closed file")]

    def to_a_full_disk(*_table: Any, **_told: Any) -> None:
        raise raised.pop(0)

    monkeypatch.setattr(pq.ParquetWriter, "write_table", to_a_full_disk)
    with pytest.raises(OSError, match=r"No space left: .*runs\.parquet"):
        run_campaign(small(0.2), 40, tmp_path / "c")
    assert not list((tmp_path / "c").iterdir())


def test_rows_are_written_while_the_campaign_runs_and_progress_counts_up_to_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its memory does not grow with the number of runs."""
    monkeypatch.setattr(results, "BATCH", 10)
    compute_here(monkeypatch)
    growing, sizes = tmp_path / "c" / "runs.parquet.unfinished", dict[int, int]()

    def look(done: int) -> None:
        sizes[done] = growing.stat().st_size

    run_campaign(small(0.2), 40, tmp_path / "c", progress=look)
    assert list(sizes) == list(range(1, 41))
    assert len(set(sizes.values())) == 5


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="exists already and is not overwritten"):
        run_campaign(small(), 1, tmp_path, workers=1)
