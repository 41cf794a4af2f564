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

"""Latency from a state to the torque that answers it, as any node on the graph can measure it."""

import time
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.contract.cdr import header_stamp
from ppc_attitude.contract.topics import ATTITUDE, TORQUE_COMMAND, Topic
from ppc_attitude.nodes.messages import recorded, subscribe
from ppc_attitude.nodes.visiting import listening, visiting
from ppc_attitude.science.stamps import seconds

_LOOK = 0.05  # [s]


class Latencies(NamedTuple):
    """The measured latencies."""

    states: int  # that were seen
    period: float  # median time between their stamps [s]; NaN for fewer than two
    answered: NDArray[np.float64]  # [s] from the arrival of each answered state to its command's

    @property
    def missed(self) -> int:
        """States whose command came later than a period, or never."""
        return self.states - int(np.count_nonzero(self.answered <= self.period))


def measure(
    goes_on: Callable[[float | None], bool],
    namespace: str = "",
    joining: float = 0.0,
    now: Callable[[], float] = time.perf_counter,
) -> Latencies:
    """Listen to states and torque commands as long as `goes_on` is true.

    It gets the time at which the first state came, by `now` [s], or None before that.
    States that come within `joining` [s] after it do not count: a node that joins a running topic
    gets its first messages late and all at once, and those of another topic at another time.
    """
    arrivals: dict[int, float] = {}
    answers: dict[int, float] = {}

    def note(topic: Topic, times: dict[int, float], data: bytes) -> None:
        stamp = header_stamp(data, topic.msgtype)
        if stamp is not None:
            times.setdefault(stamp, now())

    with visiting("latency_probe", namespace) as node:
        for topic, times in ((ATTITUDE, arrivals), (TORQUE_COMMAND, answers)):
            subscribe(node, topic, partial(note, topic, times), recorded(topic), raw=True)
        with listening(node) as listen:
            while goes_on(next(iter(arrivals.values()), None)):
                listen(_LOOK)
    begin = min(arrivals.values(), default=0.0) + joining
    # The last state may be answered after the measurement.
    stamps = sorted(stamp for stamp, arrival in arrivals.items() if arrival >= begin)[:-1]
    steps = np.diff([seconds(stamp) for stamp in stamps])
    trips = [answers[stamp] - arrivals[stamp] for stamp in stamps if stamp in answers]
    period = float(np.median(steps)) if len(steps) else np.nan
    return Latencies(len(stamps), period, np.array(trips, np.float64))
