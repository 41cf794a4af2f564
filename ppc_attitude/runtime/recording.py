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
sent ahead and never reached its instant is in no record, and makes no gap. What others send while
no state comes is written all the same, and makes one. Whether a record is complete is judged while
it grows, in memory that does not grow with it.
"""

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from math import inf
from statistics import median_low

from ppc_attitude.contract.run_record import STEADY
from ppc_attitude.contract.topics import ATTITUDE
from ppc_attitude.runtime.publishers import Publishers
from ppc_attitude.science.stamps import seconds

_LEAD = ATTITUDE.name
_MOST_AHEAD = 200_000  # messages that may wait for their states: what publishers keep, and more
_EVERY = 500  # states between two reports of how far the record has come
_REMEMBERED = 50_000  # states: a reader keeps as many messages, which may come after their states
_JOINS = 2.0  # [s] by the wall clock in which who joins a run may hear others and no state
_FEW = 10  # instants beyond the last state: a stranger's stamps, or the last answers
_FIRST = 9  # steps whose median is the rhythm: the first one alone may be of any length
_MOST_JUMPS = 5  # that are told one by one

Write = Callable[[str, int, bytes], None]


@dataclass
class _Tally:
    count: int = 0
    total: int = 0  # sum of the stamps: equal counts with other stamps give another sum
    last: int = -1
    previous: int = -1

    def until(self, stamp_ns: int) -> tuple[int, int]:
        """Count and sum of the stamps up to one that is the last or the last but one."""
        if self.last > stamp_ns and self.previous == stamp_ns:
            return self.count - 1, self.total - self.last
        return self.count, self.total


class Completeness:
    """Compare every topic's stamps with those of the states.

    A run that is stopped may lack the answers to its last state; any other difference is a gap.
    After a reset of the plant time begins again: what came before is compared by itself.
    """

    def __init__(self) -> None:
        # Of each topic, one a stretch of time without a reset; the last is the present one's.
        self._tallies: defaultdict[str, list[_Tally]] = defaultdict(lambda: [_Tally()])
        self._period: int | None = None
        self._steps: list[tuple[int, int]] = []  # pairs of states that are not yet weighed
        self._weighed = self._steady = self._jumped = 0
        self._jumps: list[str] = []

    def add(self, name: str, stamp_ns: int) -> None:
        """Count one message of a topic."""
        tallies = self._tallies[name]
        if stamp_ns == 0 < tallies[-1].last:
            tallies.append(_Tally())
        tally = tallies[-1]
        if name == _LEAD and tally.count:
            self._look_for_jump(tally.last, stamp_ns)
        tally.count += 1
        tally.total += stamp_ns
        tally.previous, tally.last = tally.last, stamp_ns

    def _look_for_jump(self, last: int, stamp_ns: int) -> None:
        if stamp_ns > last:
            self._steps.append((last, stamp_ns))
        if self._period is not None or len(self._steps) == _FIRST:
            self._weigh_steps()

    def _weigh_steps(self) -> None:
        """See which steps are longer than usual."""
        if self._period is None and self._steps:
            self._period = median_low(after - before for before, after in self._steps)
        for before, after in self._steps:
            ratio = (after - before) / (self._period or 1)
            self._weighed += 1
            self._steady += abs(ratio - 1.0) <= STEADY
            if ratio > 1.5:
                self._jumped += 1
                if self._jumped <= _MOST_JUMPS:
                    text = f"{_LEAD} jumps from {seconds(before):.6f} s to {seconds(after):.6f} s"
                    self._jumps.append(text)
        self._steps.clear()

    def _told_jumps(self) -> list[str]:
        """Describe the gaps of the states; a rhythm that changes has none."""
        self._weigh_steps()
        if 4 * self._steady < 3 * self._weighed:
            return []
        more = self._jumped - len(self._jumps)
        return self._jumps + ([f"{_LEAD} jumps {more} times more"] if more else [])

    def gaps(self, expected: Iterable[str] = ()) -> list[str]:
        """Describe what is missing; empty if nothing is.

        The expected topics must have come, once a state has been answered.
        """
        if _LEAD not in self._tallies:
            others = [f"{name} without {_LEAD}" for name in self._tallies]
            return others or [f"{_LEAD} never came"]
        found = self._told_jumps()
        *earlier, present = self._tallies[_LEAD]
        if earlier or present.count > 1:
            found += [f"{name} never came" for name in expected if name not in self._tallies]
        for name, tallies in self._tallies.items():
            if len(tallies) != len(earlier) + 1:
                found.append(f"{name} begins again at another time than {_LEAD}")
        for k in range(len(earlier)):
            ended = {name: each[k] for name, each in self._tallies.items() if k < len(each) - 1}
            found += self._compare(ended)
        return found + self._compare({name: each[-1] for name, each in self._tallies.items()})

    def _compare(self, tallies: dict[str, _Tally]) -> list[str]:
        """Compare the topics over a stretch of time without a reset."""
        states = tallies[_LEAD]
        found = []
        for name, tally in tallies.items():
            end = min(tally.last, states.last)
            if tally.until(end) != states.until(end):
                found.append(
                    f"{name} has {tally.count} messages until {seconds(tally.last):.6f} s, "
                    f"{_LEAD} {states.count} until {seconds(states.last):.6f} s"
                )
        return found


@dataclass(slots=True)
class _Lane:
    """One topic with a sample at each instant."""

    epoch: int = 0  # how often its time has begun again
    heard: int = -1  # the latest stamp [ns]
    written: int = 0  # of which epoch the last sample was that was written
    last: int = -1  # the newest stamp [ns] that was written of that epoch
    data: bytes = b""  # what was written with it
    before: tuple[int, bytes] = (-1, b"")  # the same of the sample before
    surplus: int = 0  # messages beside the first one of their instant
    publishers: Publishers = field(default_factory=Publishers)


class Recording:
    """The messages of one run, in one namespace; `write` gets topic, time [ns] and bytes."""

    def __init__(self, write: Write) -> None:
        self._write = write
        self._completeness = Completeness()
        self._lanes: defaultdict[str, _Lane] = defaultdict(_Lane)
        self._ends: list[int] = []  # the last state [ns] before each new beginning
        # What waits for its state: topic, bytes, and if it was sent ahead, by epoch and stamp [ns].
        self._ahead: dict[tuple[int, int], list[tuple[str, bytes, bool]]] = {}
        self._waiting = 0  # how many messages those are
        self.now = -1  # the newest state [ns]; -1: none has come
        self._end = inf  # the last state [ns], once it is known
        self._heard = inf  # when the first message came, by the wall clock [s]
        self._states: dict[int, None] = {}  # stamps [ns] of the latest ones, in their order
        self._unreported = 0
        self._with_state: dict[str, bytes] = {}  # the latest of each topic

    def event(self, name: str, stamp_ns: int | None, data: bytes, with_state: bool = False) -> None:
        """Write a message that is no sample, at its own time or at that of the newest state.

        What the plant sends `with_state` comes again with a state that it repeats: with one stamp
        it is one message.
        """
        if with_state and stamp_ns is not None:
            if self._with_state.get(name) == data:
                return
            self._with_state[name] = data
        time_ns = max(self.now, 0) if stamp_ns is None or stamp_ns < 0 else stamp_ns
        self._write(name, time_ns, data)

    def sample(
        self,
        name: str,
        stamp_ns: int | None,
        data: bytes,
        number: int | None,
        now: float,
        ahead: bool = False,
    ) -> None:
        """Write a sample when its state has come; `now` is the time of the wall clock [s].

        What its node sends `ahead` may be of an instant that is skipped, and is in no record then.
        The stamp [ns] is None where none can be read. The number is the one that the publisher gave
        the message, and None where the middleware does not tell it.
        """
        if stamp_ns is None or stamp_ns < 0:
            self.event(name, stamp_ns, data)
            return
        if stamp_ns > self._end:
            return
        self._heard = min(self._heard, now)
        lane = self._lanes[name]
        if number is not None:
            lane.publishers.hear(number, stamp_ns, now)
        if stamp_ns == 0 < lane.heard:
            self._begin_again(name, lane)
        lane.heard = stamp_ns
        if stamp_ns <= lane.last and self._is_repeated(lane, stamp_ns, data):
            return  # a peer's repeated answer to a repeated state
        if name == _LEAD:
            self._keep(name, lane, lane.epoch, stamp_ns, data)
            self._lead(stamp_ns, now)
        elif self._is_present(lane, stamp_ns):
            if not ahead or self._has_state(lane, stamp_ns):
                self._keep(name, lane, lane.epoch, stamp_ns, data)
        elif lane.epoch >= len(self._ends):
            self._wait(name, lane, stamp_ns, data, ahead)

    def _begin_again(self, name: str, lane: _Lane) -> None:
        lane.epoch += 1
        if name == _LEAD:
            self._ends.append(self.now)
            self.now = -1
            self._states.clear()
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

    def _has_state(self, lane: _Lane, stamp_ns: int) -> bool:
        """True if an instant that has passed was a state's, as far as these are remembered."""
        oldest = next(iter(self._states), 0)
        return lane.epoch < len(self._ends) or stamp_ns < oldest or stamp_ns in self._states

    def _wait(self, name: str, lane: _Lane, stamp_ns: int, data: bytes, ahead: bool) -> None:
        waiting = self._ahead.setdefault((lane.epoch, stamp_ns), [])
        if (name, data, ahead) in waiting:
            return
        if self._waiting >= _MOST_AHEAD:  # no run is so far ahead: no states come any more
            self._pass((lane.epoch, stamp_ns))
            waiting = self._ahead.setdefault((lane.epoch, stamp_ns), [])
        self._waiting += 1
        waiting.append((name, data, ahead))

    def _lead(self, stamp_ns: int, now: float) -> None:
        """Take a state, and write the messages that were ahead of it."""
        present = len(self._ends), stamp_ns
        # Who joins a run hears answers to states that it has not heard: they are left out.
        self._pass(present, joins=self.now < 0 and now < self._heard + _JOINS)
        self.now = max(self.now, stamp_ns)
        self._unreported += 1
        self._states[stamp_ns] = None
        if len(self._states) > _REMEMBERED:
            del self._states[next(iter(self._states))]
        for name, data, _ in self._ahead.pop(present, ()):
            self._waiting -= 1
            self._keep(name, self._lanes[name], len(self._ends), stamp_ns, data)

    def _pass(self, until: tuple[int, float], joins: bool = False) -> None:
        """Write what was sent at instants whose states have not come, unless the recorder `joins`.

        What was sent ahead of them is dropped.
        """
        while self._ahead and (first := next(iter(self._ahead))) < until:
            for name, data, ahead in self._ahead.pop(first):
                self._waiting -= 1
                if first[0] == until[0] and not (ahead or joins):
                    self._keep(name, self._lanes[name], *first, data)

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

    def end(self) -> None:
        """Leave out what comes of later instants than the newest state."""
        self._end = self.now

    def progress(self) -> int | None:
        """Newest recorded state [ns], once in a while, so that a plant that waits may go on."""
        if self._unreported < _EVERY:
            return None
        self._unreported = 0
        return self.now

    def gaps(self, expected: Iterable[str]) -> list[str]:
        """Describe what is missing, or not of one node alone, at the end; empty if nothing is."""
        if self.now >= 0 and len(self._ahead) > _FEW:  # states come no more, and others go on
            self._pass((len(self._ends), inf))
        return self._completeness.gaps(expected) + [
            f"{name} came from several nodes: {lane.publishers.nodes}"
            for name, lane in self._lanes.items()
            if lane.publishers.several
        ]

    def see(self, name: str, nodes: Mapping[Hashable, str], now: float) -> None:
        """Take the nodes that publish on a topic, as the graph shows them (`Publishers.see`)."""
        if name in self._lanes:
            self._lanes[name].publishers.see(nodes, now)

    def surplus(self) -> dict[str, int]:
        """How many messages of each topic came beside the first one of their instant."""
        return {name: lane.surplus for name, lane in self._lanes.items() if lane.surplus}
