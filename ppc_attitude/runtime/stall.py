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

"""Whether a run still goes on, judged by its simulated time and by how long its nodes starved."""

from collections.abc import Callable, Iterable, Mapping
from math import inf

from ppc_attitude.contract.topics import PLANT

_AFTER = 30.0  # [s] without a step after which a run is given up


class Stall:
    """Tells when a run has stalled; `now` is always the time of the wall clock [s].

    Time in which a node waited for the processor does not count: nobody's fault. Time in which a
    node uses the processor counts: one that computes for ever never answers.
    """

    def __init__(self, now: float) -> None:
        self._advanced = now
        self._heard = inf  # when the plant told its time, be it the same as before
        self._starved: Mapping[str, float] = {}

    def advance(self, now: float, starved: Mapping[str, float]) -> None:
        """Take that simulated time went on, and how long each node had starved by then [s]."""
        self._advanced, self._starved = now, starved

    def hear(self, now: float) -> None:
        """Take that the plant has told its time."""
        self._heard = now

    def reason(
        self,
        now: float,
        starvation: Callable[[], Mapping[str, float]],
        hindrances: Callable[[], Iterable[str]],
    ) -> str:
        """Say why the run is to be given up; empty if it goes on, or nobody knows what hinders it.

        Parameters
        ----------
        starvation : callable
            Gives how long each node has starved [s].
        hindrances : callable
            Gives what the nodes say that they wait for, or what else is known.
        """
        silent = now - self._advanced
        if silent < _AFTER:
            return ""
        lost = max(total - self._starved.get(name, 0.0) for name, total in starvation().items())
        if silent - lost < _AFTER:
            return ""
        why = "; ".join(dict.fromkeys(filter(None, hindrances())))
        if now - self._heard - lost >= _AFTER:
            why = why or f"{PLANT} neither goes on nor ends"
        return why and f"no step for {_AFTER:g} s: {why}"
