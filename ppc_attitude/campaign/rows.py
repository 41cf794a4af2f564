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

"""One run of a campaign: simulated, judged, and reduced to a flat row and its levels over time."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.analysis.metrics import (
    APPLIED,
    ATTITUDE_OUTSIDE,
    ERROR_AFTER_DEADLINE,
    LOST,
    RATE,
    RATE_OUTSIDE,
    RATE_OUTSIDE_AFTER_HIT,
    RECOVERY,
    SETTLED,
    SETTLING_TIME,
    TERMINAL_ERROR,
    analyse,
)
from ppc_attitude.analysis.series import attitude_errors
from ppc_attitude.analysis.verdict import Metrics, Verdict
from ppc_attitude.campaign.declaration import Campaign
from ppc_attitude.campaign.draw import DRAWN, draw, scenario_of, scenario_with
from ppc_attitude.campaign.fan import QUANTITIES, UNKNOWN, Levels, levels_of, time_bins
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.versions import versions
from ppc_attitude.simulation.closed_loop import record_of, run_samples, stamps_of
from ppc_attitude.simulation.samples import new_samples

Row: TypeAlias = dict[str, Any]

KEYS: dict[str, str] = {
    SETTLING_TIME: "settling_time",
    ERROR_AFTER_DEADLINE: "error_after_deadline",
    TERMINAL_ERROR: "terminal_error",
    RATE: "rate",
    APPLIED: "applied_torque",
    ATTITUDE_OUTSIDE: "outside_attitude_envelope",
    RATE_OUTSIDE: "outside_rate_envelope",
    RATE_OUTSIDE_AFTER_HIT: "outside_rate_envelope_after_hit",
    RECOVERY: "recovery",
    LOST: "lost_messages",
}
"""Requirement to the key that its columns bear: `met_<key>`, `value_<key>`, `limit_<key>`."""

METRICS = tuple(each.name for each in fields(Metrics) if each.name != "disturbances")
COLUMNS: dict[str, type] = {
    "index": int,
    **{name: int if name == "noise_seed" else float for name in DRAWN},
    **dict.fromkeys(METRICS, float),
    "recovery_time_s": float,
    "converged": bool,
    "all_met": bool,
    **{
        f"{part}_{key}": kind
        for key in KEYS.values()
        for part, kind in (("met", bool), ("value", float), ("limit", str))
    },
    "error": str,
}
"""Every column of a row and its type; what does not apply to a run is None.

`recovery_time_s` is that of the last sudden disturbance; `converged`: the attitude error stays
settled over the last 20 s; `error`: why the run broke, in which case nothing was judged.
"""

_DECISIVE = ("ppc_attitude", "numpy", "numba", "scipy")


class CampaignError(RuntimeError):
    """The campaign cannot go on; says why."""


@dataclass(frozen=True)
class Outcome:
    """What a campaign keeps of one run.

    Attributes
    ----------
    row : dict
        A value for every key of `COLUMNS`.
    levels : ndarray of uint8, shape (len(QUANTITIES), bins)
        See `fan`.
    """

    row: Row
    levels: Levels


@dataclass(frozen=True)
class Grid:
    """What all runs of a campaign have in common: instants and time bins."""

    stamps_ns: NDArray[np.int64]
    starts: NDArray[np.intp]
    ends: Array


@lru_cache(maxsize=4)
def grid_of(rate: float, duration: float) -> Grid:
    """Instants and time bins of runs at a rate [Hz] and of a duration [s]."""
    stamps_ns = stamps_of(rate, duration)
    return Grid(stamps_ns, *time_bins(stamps_ns))


def run_one(campaign: Campaign, index: int, samples: Array | None = None) -> Outcome:
    """Run one index of a campaign; a failure is an outcome as well.

    Parameters
    ----------
    campaign : Campaign
        What to run.
    index : int
        Which run.
    samples : ndarray, optional
        As of `run_samples`: a buffer for many runs.

    Returns
    -------
    Outcome
        The same to the last bit wherever and whenever it is run.
    """
    drawn: Mapping[str, Any] = {}
    try:
        drawn = draw(campaign, index)
        grid = grid_of(campaign.rate, campaign.duration)
        scenario = scenario_with(campaign, drawn)
        samples = run_samples(scenario, grid.stamps_ns, samples, campaign.timetable)
        record = record_of(scenario, grid.stamps_ns, samples)
        verdict = analyse(record)
        levels = levels_of(record, attitude_errors(record), grid.starts)
        return Outcome(_row(index, drawn, verdict), levels)
    except Exception as error:  # whatever it is, it must cost this run only
        return broken(campaign, index, f"{type(error).__name__}: {error}", drawn)


def run_chunk(campaign: Campaign, start: int, stop: int) -> list[Outcome]:
    """Run the indices from start up to, not including, stop.

    Raises
    ------
    CampaignError
        This process has other versions than the campaign's, so its numbers could differ.
    """
    difference = _difference(versions(), campaign.made_with)
    if difference:
        raise CampaignError(
            f"a worker has other versions than this command and could give other numbers: "
            f"{difference}"
        )
    samples = new_samples(grid_of(campaign.rate, campaign.duration).stamps_ns.size)
    return [run_one(campaign, index, samples) for index in range(start, stop)]


def rerun(campaign: Campaign, index: int) -> tuple[RunRecord, Verdict]:
    """Run one index again and keep all of it.

    Raises
    ------
    ConfigurationError
        The index is negative, or what was drawn is impossible.
    AnalysisError
        The run cannot be judged.
    """
    scenario = scenario_of(campaign, index)
    stamps_ns = grid_of(campaign.rate, campaign.duration).stamps_ns
    record = record_of(scenario, stamps_ns, run_samples(scenario, stamps_ns))
    record = replace(record, source=f"campaign run {index}", metadata=campaign.made_with)
    return record, analyse(record)


def broken(
    campaign: Campaign, index: int, reason: str, drawn: Mapping[str, Any] | None = None
) -> Outcome:
    """Outcome of a run that gave no result."""
    row = dict.fromkeys(COLUMNS) | {"index": index, "error": reason, **(drawn or {})}
    bins = grid_of(campaign.rate, campaign.duration).starts.size
    return Outcome(row, np.full((len(QUANTITIES), bins), UNKNOWN, np.uint8))


def _row(index: int, drawn: Mapping[str, Any], verdict: Verdict) -> Row:
    metrics = verdict.metrics
    row = dict.fromkeys(COLUMNS) | {"index": index, **drawn}
    row |= {name: getattr(metrics, name) for name in METRICS}
    if metrics.disturbances:
        row["recovery_time_s"] = metrics.disturbances[-1].recovery_time_s
    if metrics.terminal_error is not None:
        row["converged"] = metrics.terminal_error < SETTLED
    row["all_met"] = verdict.all_met
    for each in verdict.requirements:
        key = KEYS[each.name]
        row[f"met_{key}"] = bool(each.met)
        row[f"value_{key}"] = each.value
        row[f"limit_{key}"] = each.limit_text
    return row


def _difference(there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """Say which versions differ of those that can change a number; empty if none does."""
    return ", ".join(
        f"{name} {there.get(name, 'absent')} there, {here.get(name, 'absent')} here"
        for name in _DECISIVE
        if there.get(name) != here.get(name)
    )
