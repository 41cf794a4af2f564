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

"""The search: CMA-ES asks, runs in process answer, and a file of the answers can be continued."""

import fcntl
import hashlib
import json
import math
import os
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, wait
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.versions import of_another_worker, versions
from ppc_attitude.contract.whole_file import naming
from ppc_attitude.contract.yaml_file import parsed_json
from ppc_attitude.falsify.goals import Goal
from ppc_attitude.falsify.space import Space
from ppc_attitude.processes.exits import RunError
from ppc_attitude.science.errors import ConfigurationError, needed_by
from ppc_attitude.simulation.closed_loop import simulate

HISTORY = "history.jsonl"
_WIDTH = 0.5  # deviation of the first generation, of numbers of the order of one
# After so many generations that find nothing new, a new search begins elsewhere.
_STALE = 40
_WORST = 1e9  # more than any goal reaches
_GLANCE = 0.1  # [s] between looks at the wish to stop
_SAME = 1e-6  # relative: on another processor the last digits differ


@dataclass(frozen=True)
class Found:
    """The state of a search."""

    runs: int  # how many were evaluated
    value: float  # largest value of the goal
    x: Array  # the choice that gave it


class Search:
    """A search that writes down every answer, so that it can go on after any interruption.

    The optimiser's questions follow from its seed and the answers: to continue, it is asked anew
    and given the answers of the file in the folder.

    Raises
    ------
    ConfigurationError
        `cma` is not installed.
    """

    def __init__(self, space: Space, goal: Goal, folder: Path, seed: int) -> None:
        with needed_by("the adversary needs CMA-ES", "guarantee"):
            import cma
        self._cma: Any = cma
        self.space, self.goal, self._seed = space, goal, seed
        self._file = folder / HISTORY
        folder.mkdir(parents=True, exist_ok=True)
        identity = json.dumps([space.to_json(), asdict(goal), seed], sort_keys=True)
        self._digest = hashlib.sha256(identity.encode()).hexdigest()

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """Keep the file of the answers to this search; two at once would mix theirs."""
        with self._file.open("a", encoding="utf-8") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                told = f"another search uses {self._file.parent}; allowed: an unused folder"
                raise ConfigurationError(told) from None
            yield

    def _read(self) -> list[list[float]]:
        """Answers of earlier sessions; of a line that was cut, none."""
        text, first = self._file.read_text(encoding="utf-8"), json.dumps({"search": self._digest})
        if first.startswith(text):
            self._file.write_text(f"{first}\n", encoding="utf-8")
            return []
        whole, _, _ = text.rpartition("\n")
        lines = whole.split("\n")
        try:
            known = parsed_json(lines[0])["search"]
            answers = [[float(each) for each in parsed_json(line)] for line in lines[1:]]
        except (ValueError, KeyError, TypeError) as error:
            raise ConfigurationError(f"{self._file} is no history of a search: {error}") from None
        if known != self._digest:
            raise ConfigurationError(
                f"{self._file} belongs to another search: choose another folder, or the same "
                "configuration, goal, bounds and seed"
            )
        os.truncate(self._file, len(f"{whole}\n".encode()))
        return answers

    def run(
        self,
        runs: int,
        seconds: float,
        executor: Executor,
        stop: threading.Event,
        check: Callable[[], None] = lambda: None,
    ) -> Iterator[Found]:
        """Search until so many runs, or so much time, and yield after each generation.

        The runs include those of earlier sessions, the time [s] is that of this one. A stop ends
        the search at once; the present generation is left out. While runs are waited for, `check`
        raises if there is nobody to wait for.

        Raises
        ------
        ConfigurationError
            Another search uses or has used the folder, its file has been changed, or its worst case
            flies otherwise now.
        RunError
            A worker has other versions than this process.
        """
        end = time.monotonic() + seconds
        best = Found(0, -np.inf, np.zeros(self.space.size))
        value = partial(evaluated, self.space, self.goal)

        def flown(choices: list[Array]) -> list[float] | None:
            flights = [executor.submit(_elsewhere, versions(), value, each) for each in choices]
            while wait(flights, timeout=_GLANCE).not_done:
                check()
                if stop.is_set():
                    return None
            return [each.result() for each in flights]

        with self._locked():
            known = self._read()
            answers = iter(known)
            for strategy, questions in self._generations():
                values = next(answers, None)
                if values is None:
                    if known and (again := flown([best.x])):
                        self._see_that_it_repeats(best.value, again[0])
                    known = []
                    if best.runs >= runs or stop.is_set() or time.monotonic() > end:
                        return
                    if (values := flown(questions)) is None:
                        return
                    with naming(self._file), self._file.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(values) + "\n")
                if len(values) != len(questions):
                    told = f"a generation of {len(values)} runs; allowed: {len(questions)}"
                    raise ConfigurationError(f"{self._file} has {told}")
                # CMA-ES minimises; a run that was not finite counts as the worst case.
                strategy.tell(questions, [-min(each, _WORST) for each in values])
                top = int(np.argmax(values))
                best = replace(best, runs=best.runs + len(values))
                if values[top] > best.value:
                    best = replace(best, value=values[top], x=questions[top])
                yield best

    def _see_that_it_repeats(self, before: float, now: float) -> None:
        """Refuse answers of an earlier session that the present code would not give."""
        if not math.isclose(now, before, rel_tol=_SAME):
            raise ConfigurationError(
                f"{self._file}: its worst case gave {before:g} and gives {now:g} now, so that the "
                "law, a component or a version has changed: choose another folder"
            )

    def _generations(self) -> Iterator[tuple[Any, list[Array]]]:
        """Yield an optimiser and what it asks, with a new one elsewhere when its search ends."""
        stream = np.random.default_rng(self._seed)
        while True:
            strategy = self._cma.CMAEvolutionStrategy(
                stream.standard_normal(self.space.size),
                _WIDTH,
                {
                    "seed": int(stream.integers(1, 2**31)),
                    "verbose": -9,
                    "tolflatfitness": _STALE,
                    "tolstagnation": _STALE,
                },
            )
            while not strategy.stop():
                yield strategy, strategy.ask()


def _elsewhere(made_with: Mapping[str, str], value: Callable[[Array], float], x: Array) -> float:
    """Value for one choice, if the process that computes has the versions of the one that asks."""
    if told := of_another_worker(made_with):
        raise RunError(told)
    return value(x)


def evaluated(space: Space, goal: Goal, x: Array) -> float:
    """Value of the goal for one choice."""
    scenario = space.scenario(x)
    return goal.value(simulate(scenario, space.duration))
