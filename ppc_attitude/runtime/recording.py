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

"""Which messages of a run are written when, and which are missing; without ROS and without a bag.

The states lead. A message counts for the record when the state of its stamp has come: so what was
sent ahead and never reached its instant is in no record, and makes no gap.
"""

from collections.abc import Callable, Hashable, Iterable, Mapping

from ppc_attitude.contract.topics import ATTITUDE
from ppc_attitude.runtime.completeness import Completeness
from ppc_attitude.runtime.publishers import Publishers

_LEAD = ATTITUDE.name
_MOST_AHEAD = 200_000  # messages that may wait for their states: what publishers keep, and more
_EVERY = 500  # states between two reports of how far the record has come

Write = Callable[[str, int, bytes], None]


class _Lane:
    """One topic with a sample at each instant."""

    def __init__(self) -> None:
        self.epoch = 0  # how often its time has begun again
        self.heard = -1  # the latest stamp [ns]
        self.written = 0  # of which epoch the last sample was that was written
        self.last = -1  # the newest stamp [ns] that was written of that epoch
        self.data = b""  # what was written with it
        self.before = -1, b""  # the same of the sample before
        self.surplus = 0  # messages beside the first one of their instant
        self.publishers = Publishers()


class Recording:
    """The messages of one run, in one namespace.

    Parameters
    ----------
    write : callable
        Writes a message: topic, time in the record [ns], bytes.
    """

    def __init__(self, write: Write) -> None:
        self._write = write
        self._completeness = Completeness()
        self._lanes: dict[str, _Lane] = {}
        self._ends: list[int] = []  # the last state [ns] before each new beginning
        self._ahead: dict[tuple[int, int], list[tuple[str, bytes]]] = {}
        self._waiting = 0
        self.now = -1  # the newest state [ns]; -1: none has come
        self._unreported = 0

    def event(self, name: str, stamp_ns: int | None, data: bytes) -> None:
        """Write a message that is no sample, at its own time or at that of the newest state."""
        time_ns = max(self.now, 0) if stamp_ns is None or stamp_ns < 0 else stamp_ns
        self._write(name, time_ns, data)

    def sample(
        self, name: str, stamp_ns: int | None, data: bytes, number: int | None, now: float
    ) -> None:
        """Write a sample when its state has come.

        Parameters
        ----------
        name : str
            Topic.
        stamp_ns : int or None
            Its stamp [ns]; None if it has none that can be read.
        data : bytes
            The message.
        number : int or None
            The number that its publisher gave it; None where the middleware does not tell.
        now : float
            Time of the wall clock [s].
        """
        if stamp_ns is None or stamp_ns < 0:
            self.event(name, stamp_ns, data)
            return
        lane = self._lanes.get(name) or self._lanes.setdefault(name, _Lane())
        if number is not None:
            lane.publishers.hear(number, stamp_ns, now)
        if stamp_ns == 0 < lane.heard:
            self._begin_again(name, lane)
        lane.heard = stamp_ns
        if stamp_ns <= lane.last and self._is_repeated(lane, stamp_ns, data):
            return  # a peer's repeated answer to a repeated state
        if name == _LEAD:
            self._keep(name, lane, lane.epoch, stamp_ns, data)
            self._lead(stamp_ns)
        elif self._is_present(lane, stamp_ns):
            self._keep(name, lane, lane.epoch, stamp_ns, data)
        elif lane.epoch >= len(self._ends):
            self._wait(name, lane, stamp_ns, data)

    def _begin_again(self, name: str, lane: _Lane) -> None:
        lane.epoch += 1
        if name == _LEAD:
            self._ends.append(self.now)
            self.now = -1
            self._ahead = {key: each for key, each in self._ahead.items() if key[0] >= lane.epoch}
            self._waiting = sum(map(len, self._ahead.values()))

    def _is_repeated(self, lane: _Lane, stamp_ns: int, data: bytes) -> bool:
        latest = lane.last, lane.data
        return lane.written == lane.epoch and (stamp_ns, data) in (latest, lane.before)

    def _is_present(self, lane: _Lane, stamp_ns: int) -> bool:
        """True if the state of this instant has come, or a later one."""
        begun = len(self._ends)
        if lane.epoch == begun:
            return stamp_ns <= self.now
        return lane.epoch < begun and stamp_ns <= self._ends[lane.epoch]

    def _wait(self, name: str, lane: _Lane, stamp_ns: int, data: bytes) -> None:
        waiting = self._ahead.setdefault((lane.epoch, stamp_ns), [])
        if (name, data) in waiting:
            return
        if self._waiting >= _MOST_AHEAD:  # no run is so far ahead: it is written as it came
            self._keep(name, lane, lane.epoch, stamp_ns, data)
            return
        self._waiting += 1
        waiting.append((name, data))

    def _lead(self, stamp_ns: int) -> None:
        """Take a state, and write the messages that were ahead of it."""
        begins = self.now < 0
        self.now = max(self.now, stamp_ns)
        self._unreported += 1
        for name, data in self._ahead.pop((len(self._ends), stamp_ns), ()):
            self._waiting -= 1
            self._keep(name, self._lanes[name], len(self._ends), stamp_ns, data)
        if begins and self._ahead:  # what came before the first state belongs to none
            early = [key for key in self._ahead if key[0] == len(self._ends) and key[1] < stamp_ns]
            self._waiting -= sum(len(self._ahead.pop(key)) for key in early)

    def _keep(self, name: str, lane: _Lane, epoch: int, stamp_ns: int, data: bytes) -> None:
        """Write a sample, and count it if it is the first one of its instant."""
        if epoch > lane.written:
            lane.written, lane.last, lane.data = epoch, -1, b""
        if stamp_ns <= lane.last:
            lane.surplus += 1
        else:
            lane.before = lane.last, lane.data
            lane.last, lane.data = stamp_ns, data
            self._completeness.add(name, stamp_ns)
        self._write(name, stamp_ns, data)

    def progress(self) -> int | None:
        """Newest recorded state [ns], once in a while, so that a plant that waits may go on."""
        if self._unreported < _EVERY:
            return None
        self._unreported = 0
        return self.now

    def gaps(self, expected: Iterable[str]) -> list[str]:
        """Describe what is missing; empty if nothing is."""
        return self._completeness.gaps(expected)

    def see(self, name: str, nodes: Mapping[Hashable, str], now: float) -> None:
        """Take the nodes that publish on a topic, as the graph shows them (`Publishers.see`)."""
        if name in self._lanes:
            self._lanes[name].publishers.see(nodes, now)

    def shared(self) -> dict[str, str]:
        """Topics that more than one node has published on, message by message, and the nodes."""
        return {
            name: lane.publishers.nodes
            for name, lane in self._lanes.items()
            if lane.publishers.several
        }

    def surplus(self) -> dict[str, int]:
        """How many messages of each topic came beside the first one of their instant."""
        return {name: lane.surplus for name, lane in self._lanes.items() if lane.surplus}
