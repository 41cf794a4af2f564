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

"""The result of a campaign: how many runs meet a requirement, the worst ones, a sample to draw."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ppc_attitude.analysis.requirements import Requirements, names_of
from ppc_attitude.campaign.rows import PARTS, Row
from ppc_attitude.campaign.variables import Variable, varying

WORST = 5
"""Runs that are listed as the worst of each requirement."""
SAMPLE_SIZE = 3000
"""Runs that a figure shows: the first that meet everything, and as many that do not."""
_MOST_LIMITS = 3  # that are told apart; an actuator of random strength has one a run


@dataclass(frozen=True)
class Fraction:
    """A count out of a number of runs, with its 95 % Wilson interval."""

    met: int
    judged: int
    broken: int = 0  # how many of those judged broke, which counts as missed

    @property
    def value(self) -> float:
        """The share; NaN if nothing was judged."""
        return self.met / self.judged if self.judged else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper end of the interval; 0 and 1 if nothing was judged."""
        if not self.judged:
            return 0.0, 1.0
        from scipy.stats import binomtest  # costs half a second, and most processes ask for none

        low, high = binomtest(self.met, self.judged).proportion_ci(method="wilson")
        return float(low), float(high)

    def __str__(self) -> str:
        """Share with its interval, in percent."""
        if not self.judged:
            return "–"
        low, high = self.interval
        broken = f"; broken and counted as missed: {self.broken}" if self.broken else ""
        return f"{100 * self.value:.2f} % ({100 * low:.2f} … {100 * high:.2f}){broken}"

    def to_json(self) -> dict[str, Any]:
        """Counts, share and interval."""
        low, high = self.interval
        share = self.value if self.judged else None
        return {"met": self.met, "judged": self.judged, "fraction": share, "ci95": [low, high]}


@dataclass
class Tally:
    """The tally of one requirement."""

    met: int = 0
    judged: int = 0
    not_judged: int = 0
    limits: dict[str, None] = field(default_factory=dict)  # as many as are told apart, and one
    worst: list[tuple[bool, float, int]] = field(default_factory=list)  # (missed, value, −index)

    def add(self, met: bool | None, value: float | None, limit: str, index: int) -> None:
        """Count one run; `met` is None if it was not judged."""
        if limit and len(self.limits) <= _MOST_LIMITS:
            self.limits[limit] = None
        if met is None:
            self.not_judged += 1
            return
        self.judged += 1
        self.met += met
        # Never to recover is the worst that a run can do. Where each run has a limit of its own,
        # one that met it may have reached more than one that missed it.
        entry = (not met, math.inf if value is None else value, -index)
        self.worst = sorted([*self.worst, entry], reverse=True)[:WORST]

    @property
    def fraction(self) -> Fraction:
        """How many runs meet it."""
        return Fraction(self.met, self.judged)

    @property
    def limit_text(self) -> str:
        """The limit, or that every run has its own."""
        several = len(self.limits) > _MOST_LIMITS
        return "each run's own" if several else ", ".join(self.limits)

    def worst_runs(self) -> list[tuple[int, float]]:
        """Index and value of the worst runs, worst first."""
        return [(-index, value) for _, value, index in self.worst]


class Summary:
    """Accumulates rows in a memory that does not grow with their number."""

    def __init__(self, required: Requirements, variables: Mapping[str, Variable]) -> None:
        self._names = names_of(required)
        self._varying = varying(variables)
        self.runs = 0
        self.all_met = 0
        self.broken = 0
        self.first_broken: tuple[int, str] | None = None
        self.tallies: dict[str, Tally] = {}
        self.faults: dict[str, Fraction] = {}
        self.passing: list[dict[str, float]] = []
        self.failing: list[dict[str, float]] = []

    def add(self, row: Row) -> None:
        """Count one run."""
        self.runs += 1
        if fault := row.get("fault"):
            before = self.faults.get(fault, Fraction(0, 0))
            met = before.met + bool(row["all_met"])  # None if the run broke
            broken = before.broken + (row["error"] is not None)
            self.faults[fault] = Fraction(met, before.judged + 1, broken)
        if row["error"] is not None:
            self.broken += 1
            self.first_broken = self.first_broken or (row["index"], row["error"])
            return
        self.all_met += row["all_met"]
        for key, name in self._names.items():
            met, value, limit, note = (row[f"{part}_{key}"] for part in PARTS)
            if met is not None or note:  # it applies to the run
                self.tallies.setdefault(name, Tally()).add(met, value, limit, row["index"])
        sample = self.passing if row["all_met"] else self.failing
        if len(sample) < SAMPLE_SIZE:
            sample.append({name: row[name] for name in self._varying if row[name] is not None})

    @property
    def fraction(self) -> Fraction:
        """How many runs miss no requirement that they are judged by; one that broke misses all."""
        return Fraction(self.all_met, self.runs, self.broken)

    def shares(self) -> list[tuple[str, Fraction]]:
        """Runs that miss nothing they are judged by: of all, and of those with each drawn fault."""
        told = "every requirement judged"
        faults = [(f"{told}, {fault}", each) for fault, each in sorted(self.faults.items())]
        return [(told, self.fraction), *faults]

    def requirements(self) -> list[tuple[str, Tally]]:
        """Every requirement that applied to some run, in the order of a verdict."""
        names = dict.fromkeys(self._names.values())  # two bounds of one error have one name
        return [(name, self.tallies[name]) for name in names if name in self.tallies]

    def to_json(self) -> dict[str, Any]:
        """All numbers of it."""
        return {
            "all_requirements": {**self.fraction.to_json(), "broken": self.broken},
            "broken": self.broken,
            "faults": {
                fault: {**each.to_json(), "broken": each.broken}
                for fault, each in sorted(self.faults.items())
            },
            "requirements": [
                {
                    "name": name,
                    "limit": tally.limit_text,
                    **tally.fraction.to_json(),
                    "not_judged": tally.not_judged,
                    "worst": [
                        {"index": index, "value": value} for index, value in tally.worst_runs()
                    ],
                }
                for name, tally in self.requirements()
            ],
        }
