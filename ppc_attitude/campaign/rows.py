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
from typing import Any, TypeAlias

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.requirements import names_of
from ppc_attitude.analysis.series import take_for_finite
from ppc_attitude.analysis.truth import pointing_errors
from ppc_attitude.analysis.verdict import Metrics
from ppc_attitude.campaign.declaration import Campaign, drawn_run, scenario_of_run
from ppc_attitude.campaign.quantile_bands import Levels, levels_of
from ppc_attitude.campaign.variables import drawn_columns
from ppc_attitude.contract.versions import of_another_worker
from ppc_attitude.simulation.closed_loop import Loop, simulate

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


class CampaignError(RuntimeError):
    """The campaign cannot go on; says why."""


@dataclass(frozen=True)
class Outcome:
    """The part of a run that a campaign keeps."""

    row: Row  # a value for every key of `row_types`
    levels: Levels | None  # shape (len(QUANTITIES), bins); None of a run that broke


def _outcome(campaign: Campaign, index: int, loop: Loop, empty: Row) -> Outcome:
    """Draw a run and run it; of its samples nothing is kept, and a failure is an outcome too."""
    drawn: Mapping[str, Any] = {}
    try:
        drawn, changed = drawn_run(campaign, index)
        record = loop.run(campaign.scenario.overlaid(changed))
        take_for_finite(record, loop.whole)
        found = {"index": index, **drawn, **_judged(Verdict(record, campaign.required))}
        levels = levels_of(record, pointing_errors(record).sizes)
        return Outcome(empty | found, levels)
    except Exception as error:  # whatever it is, it must cost this run only
        return broken(campaign, index, f"{type(error).__name__}: {error}", drawn)


def loop_of(campaign: Campaign) -> Loop:
    """Build the loop of all runs of a campaign, for one thread."""
    return Loop(campaign.scenario, campaign.stamps_ns, campaign.timetable)


def run_chunk(campaign: Campaign, start: int, stop: int, loop: Loop | None = None) -> list[Outcome]:
    """Run the indices from start up to, not including, stop.

    Each gives the same to the last bit wherever and whenever it is run. A caller with many chunks
    gives the same `loop_of` the campaign to all.

    Raises
    ------
    CampaignError
        This process has other versions than the campaign's, so its numbers could differ.
    """
    if told := of_another_worker(campaign.made_with):
        raise CampaignError(told)
    loop, empty = loop or loop_of(campaign), dict.fromkeys(row_types(campaign))
    return [_outcome(campaign, index, loop, empty) for index in range(start, stop)]


def rerun(campaign: Campaign, index: int) -> Verdict:
    """Run one index again and keep all of it.

    Raises
    ------
    ConfigurationError
        What was drawn is impossible.
    AnalysisError
        The run cannot be judged.
    """
    scenario = scenario_of_run(campaign, index)
    record = simulate(scenario, campaign.duration)
    record = replace(record, source=f"campaign run {index}", metadata=campaign.made_with)
    return Verdict(record, campaign.required)


def broken(campaign: Campaign, index: int, reason: str, drawn: Mapping[str, Any]) -> Outcome:
    """Outcome of a run that gave no result, with what was drawn."""
    row = dict.fromkeys(row_types(campaign)) | {"index": index, "error": reason, **drawn}
    return Outcome(row, None)


def _judged(verdict: Verdict) -> Row:
    metrics = verdict.metrics
    row: Row = {name: getattr(metrics, name) for name in METRICS}
    if metrics.disturbances:
        row["recovery_time_s"] = metrics.disturbances[-1].recovery_time_s
    row["converged"], row["all_met"] = metrics.converged, verdict.all_met
    for each in verdict.requirements:
        told = (each.met, each.value, each.limit_text, each.note)
        row |= {f"{part}_{each.key}": it for part, it in zip(PARTS, told, strict=True)}
    return row
