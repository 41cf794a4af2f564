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

"""Gains for laws without a guarantee: a search over the loop in process, judged by requirements.

CMA-ES changes the logarithms of the gains; every candidate flies the same drawn runs, so that two
candidates differ by their gains alone. The best is judged by other runs than those of the search.
Such a Monte Carlo verdict is an estimate and no guarantee.
"""

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.series import AnalysisError
from ppc_attitude.campaign.declaration import Campaign, scenario_of_run
from ppc_attitude.campaign.summary import Fraction
from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import CONTROLLER
from ppc_attitude.science.errors import ConfigurationError, needed_by
from ppc_attitude.simulation.closed_loop import simulate

GAINS: Mapping[str, tuple[str, ...]] = {
    "ppc": ("k", "M_omega", "beta", "K_omega"),
    "quaternion_feedback": tuple(
        f"quaternion_feedback.{name}"
        for name in ("natural_frequency", "damping", "integral_time", "max_rate")
    ),
}
"""The parameters of each law that are searched; everything else stays as it is configured."""

_WIDTH = 0.5  # of the first generation, in natural logarithms
_MISSED = 1e3  # of a run that misses a requirement: more than all else that is counted
_NEAR = 0.95  # of a limit: from here on a run that meets it costs something
_WORST = 1e6  # of a run that breaks
_BROKE = "the run broke"


@dataclass(frozen=True)
class Tuned:
    """The result of a search; all but its first two and its last are of the fresh runs."""

    gains: Mapping[str, float]  # parameters of the controller
    candidates: int  # how many sets of gains were tried
    fraction: Fraction  # how many runs met every requirement
    settling: tuple[float, float]
    """Median and largest settling time [s]; infinite if a run never settles."""
    missed: Mapping[str, int]
    """How many runs missed a requirement, by its name; the most missed comes first."""
    never_met: Sequence[str] = ()
    """Which of these no run of the search met, whatever the gains."""


def tuned(
    campaign: Campaign,
    seconds: float,
    executor: Executor,
    *,
    runs: int = 16,
    fresh: int = 200,
    candidates: int = 10_000,
    progress: Callable[[int, float], None] = lambda _count, _cost: None,
    now: Callable[[], float] = time.monotonic,
) -> Tuned:
    """Search for gains, then judge the best by fresh runs.

    Parameters
    ----------
    campaign : Campaign
        What varies, and the requirements; its scenario's gains are where the search begins.
    seconds : float
        How long to search [s].
    executor : Executor
        Where runs are computed.
    runs, fresh : int
        Runs of each candidate, and of the verdict.
    candidates : int
        Most sets of gains to try.
    progress : callable
        Called with the number of candidates and the least cost so far.
    now : callable
        Clock [s].

    Raises
    ------
    ConfigurationError
        The law has no gains that are searched, one of them is zero or is drawn, or `cma` is not
        installed.
    """
    law = campaign.scenario.controller.name
    names = GAINS.get(law)
    if names is None:
        raise ConfigurationError(f"controller = {law}; allowed for a search: {', '.join(GAINS)}")
    with needed_by("the search needs CMA-ES", "guarantee"):
        import cma
    given = {name: campaign.scenario.number(CONTROLLER, name) for name in names}
    for name, value in given.items():
        if f"{CONTROLLER}.{name}" in campaign.variables:
            raise ConfigurationError(f"the campaign varies {name}, which the search chooses")
        if value == 0.0:  # it has no logarithm
            raise ConfigurationError(f"{name} = 0; allowed: > 0, from which the search begins")
    begin = np.log([*given.values()])

    def gains_of(x: Array) -> dict[str, float]:
        return dict(zip(names, map(_rounded, np.exp(begin + x)), strict=True))

    def mean_cost(x: Array) -> float:
        gains, costs = gains_of(x), list[float]()
        for k in range(runs):
            if is_over():
                return math.inf  # a candidate that has not flown all runs is not compared
            verdict = _verdict(campaign, k, gains)
            costs.append(cost(verdict))
            met.update(each.name for each in (verdict.requirements if verdict else ()) if each.met)
        return float(np.mean(costs))

    def is_over() -> bool:
        return tried > 0 and now() >= end

    strategy: Any = cma.CMAEvolutionStrategy(
        np.zeros(begin.size), _WIDTH, {"seed": campaign.seed + 1, "verbose": -9}
    )
    end = now() + seconds
    best, least, tried = np.zeros(begin.size), math.inf, 0
    met = {_BROKE}  # by some run of the search; this one is no requirement
    questions = [best]  # the configured gains are the first candidate
    while tried < candidates and not is_over() and not strategy.stop():
        costs = list(executor.map(mean_cost, questions))
        if tried > 0 and max(costs) < math.inf:
            strategy.tell(questions, costs)
        tried += sum(each < math.inf for each in costs)
        if min(costs) < least:
            least, best = min(costs), questions[int(np.argmin(costs))]
        progress(tried, least)
        questions = strategy.ask()
    found = _judged(campaign, gains_of(best), tried, range(runs, runs + fresh), executor)
    return replace(found, never_met=[each for each in found.missed if each not in met])


def cost(verdict: Verdict | None) -> float:
    """Cost of a run: whether it misses a requirement, how near it is to each, its settling time.

    The first outweighs the others: the aim is that as many runs as possible meet all requirements,
    and how far the other runs are from that only shows the way there.
    """
    if verdict is None:
        return _WORST
    total = 0.0 if verdict.all_met else _MISSED
    for each in verdict.requirements:
        if each.key == "lost_messages" and each.met is False:  # it diverged, and shows no more
            return _WORST
        share = each.value / each.limit if each.value is not None and each.limit > 0.0 else 0.0
        if each.met is False:
            total += 2.0 - 1.0 / share if share > 1.0 else 2.0
        else:  # other runs come nearer to the limit than these few
            total += min(max((share - _NEAR) / (1.0 - _NEAR), 0.0), 1.0)
    deadline = verdict.required.settling_deadline
    return total + _settling(verdict, 2.0 * deadline) / deadline


def _settling(verdict: Verdict, never: float) -> float:
    found = verdict.metrics
    return found.settling_time_s if found.settling_time_s is not None and found.settled else never


def _verdict(campaign: Campaign, index: int, gains: Mapping[str, float]) -> Verdict | None:
    """Verdict of one run with these gains; None if they are impossible or the run breaks."""
    try:
        scenario = scenario_of_run(campaign, index).with_values(CONTROLLER, **gains)
        return Verdict(simulate(scenario, campaign.duration), campaign.required)
    except (AnalysisError, ConfigurationError):
        return None


def _judged(
    campaign: Campaign, gains: Mapping[str, float], tried: int, indices: range, executor: Executor
) -> Tuned:
    def fly(index: int) -> tuple[bool, float, list[str]]:
        verdict = _verdict(campaign, index, gains)
        if verdict is None:
            return False, math.inf, [_BROKE]
        missed = [each.name for each in verdict.requirements if each.met is False]
        return verdict.all_met, _settling(verdict, math.inf), missed

    flown = list(executor.map(fly, indices))
    met, times = sum(each for each, _, _ in flown), [time for _, time, _ in flown]
    settling = float(np.median(times)), max(times)
    missed = Counter(name for *_, names in flown for name in names)
    return Tuned(gains, tried, Fraction(met, len(flown)), settling, dict(missed.most_common()))


def _rounded(value: float) -> float:
    """Four digits: what a file holds is what was flown."""
    return float(f"{value:.4g}")
