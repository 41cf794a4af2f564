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

from ppc_attitude.analysis.metrics import Judge, analyse
from ppc_attitude.analysis.requirements import names_of
from ppc_attitude.analysis.truth import pointing_errors
from ppc_attitude.analysis.verdict import Metrics, Verdict, all_met
from ppc_attitude.campaign.declaration import Campaign
from ppc_attitude.campaign.draw import draw, drawn_columns, scenario_of_run, scenario_with
from ppc_attitude.campaign.quantile_bands import QUANTITIES, UNKNOWN, Levels, levels_of, time_bins
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.versions import versions
from ppc_attitude.simulation.closed_loop import Loop, simulate, stamps_of

Row: TypeAlias = dict[str, Any]

_TYPES: dict[str, type] = {"noise_seed": int, "fault": str}
PARTS: dict[str, type] = {"met": bool, "value": float, "limit": str, "note": str}
"""What a row has of each requirement, and the types."""
METRICS = tuple(each.name for each in fields(Metrics) if each.type == float | None)


def row_types(campaign: Campaign) -> dict[str, type]:
    """Every column of a row and its type; what does not apply to a run is None.

    `recovery_time_s` is that of the last sudden disturbance; `met_<key>` is None where a
    requirement is not judged, and `note_<key>` says why, or what else a reader must know;
    `all_met`: no requirement was judged and missed; `error`: why the run broke, in which case
    nothing was judged.
    """
    return {
        "index": int,
        **{name: _TYPES.get(name, float) for name in drawn_columns(campaign.variables)},
        **dict.fromkeys(METRICS, float),
        "recovery_time_s": float,
        "converged": bool,
        "all_met": bool,
        **{
            f"{part}_{key}": kind
            for key in names_of(campaign.required)
            for part, kind in PARTS.items()
        },
        "error": str,
    }


_DECISIVE = ("ppc_attitude", "numpy", "numba", "scipy")


class CampaignError(RuntimeError):
    """The campaign cannot go on; says why."""


@dataclass(frozen=True)
class Outcome:
    """The part of a run that a campaign keeps.

    Attributes
    ----------
    row : dict
        A value for every key of `row_types`.
    levels : ndarray of uint8, shape (len(QUANTITIES), bins)
        See `quantile_bands`.
    """

    row: Row
    levels: Levels


@dataclass(frozen=True)
class Grid:
    """Instants and time bins, which all runs of a campaign have in common."""

    stamps_ns: NDArray[np.int64]
    starts: NDArray[np.intp]
    ends: Array


@lru_cache(maxsize=4)
def grid_of(rate: float, duration: float) -> Grid:
    """Instants and time bins of runs at a rate [Hz] and of a duration [s]."""
    stamps_ns = stamps_of(rate, duration)
    return Grid(stamps_ns, *time_bins(stamps_ns))


def loop_of(campaign: Campaign) -> Loop:
    """The loop that every run of a campaign goes through."""
    stamps_ns = grid_of(campaign.rate, campaign.duration).stamps_ns
    return Loop(campaign.scenario, stamps_ns, campaign.timetable)


def run_one(campaign: Campaign, index: int, loop: Loop | None = None) -> Outcome:
    """Run one index of a campaign; a failure is an outcome as well.

    Parameters
    ----------
    campaign : Campaign
        What to run.
    index : int
        Which run.
    loop : Loop, optional
        `loop_of` the campaign, to make it once for many runs.

    Returns
    -------
    Outcome
        The same to the last bit wherever and whenever it is run.
    """
    drawn: Mapping[str, Any] = {}
    try:
        drawn = draw(campaign, index)
        record = (loop or loop_of(campaign)).run(scenario_with(campaign, drawn))
        judge = Judge(record, campaign.required)
        starts = grid_of(campaign.rate, campaign.duration).starts
        levels = levels_of(record, pointing_errors(record).quaternions, starts)
        return Outcome(_row(campaign, index, drawn, judge), levels)
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
    loop = loop_of(campaign)
    return [run_one(campaign, index, loop) for index in range(start, stop)]


def rerun(campaign: Campaign, index: int) -> tuple[RunRecord, Verdict]:
    """Run one index again and keep all of it.

    Raises
    ------
    ConfigurationError
        The index is negative, or what was drawn is impossible.
    AnalysisError
        The run cannot be judged.
    """
    scenario = scenario_of_run(campaign, index)
    record = simulate(scenario, campaign.duration)
    record = replace(record, source=f"campaign run {index}", metadata=campaign.made_with)
    return record, analyse(record, campaign.required)


def broken(
    campaign: Campaign, index: int, reason: str, drawn: Mapping[str, Any] | None = None
) -> Outcome:
    """Outcome of a run that gave no result."""
    row = dict.fromkeys(row_types(campaign)) | {"index": index, "error": reason, **(drawn or {})}
    bins = grid_of(campaign.rate, campaign.duration).starts.size
    return Outcome(row, np.full((len(QUANTITIES), bins), UNKNOWN, np.uint8))


def _row(campaign: Campaign, index: int, drawn: Mapping[str, Any], judge: Judge) -> Row:
    metrics = judge.metrics
    row = dict.fromkeys(row_types(campaign)) | {"index": index, **drawn}
    row |= {name: getattr(metrics, name) for name in METRICS}
    if metrics.disturbances:
        row["recovery_time_s"] = metrics.disturbances[-1].recovery_time_s
    row["converged"], row["all_met"] = metrics.converged, all_met(judge.requirements)
    for each in judge.requirements:
        told = (each.met, each.value, each.limit_text, each.note)
        row |= {f"{part}_{each.key}": it for part, it in zip(PARTS, told, strict=True)}
    return row


def _difference(there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """Say which versions differ of those that can change a number; empty if none does."""
    return ", ".join(
        f"{name} {there.get(name, 'absent')} there, {here.get(name, 'absent')} here"
        for name in _DECISIVE
        if there.get(name) != here.get(name)
    )
