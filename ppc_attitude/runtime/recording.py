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

The states lead: a message belongs to the record when the state with its stamp has come. So a
message that was sent ahead for an instant that never comes is not recorded, and makes no gap. What
other nodes send while no state comes is written all the same, and makes a gap. Whether a record is
complete is judged while it grows, in memory that does not grow with it.
"""

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Mapping
from heapq import heappop, heappush
from itertools import zip_longest
from math import inf

from ppc_attitude.contract.topics import ATTITUDE, OWNED, TRUE_ATTITUDE
from ppc_attitude.runtime.lanes import Lane, Rhythm, Stretch, Told
from ppc_attitude.science.stamps import NANOSECONDS

_LEAD = ATTITUDE.name
_TRUTH = TRUE_ATTITUDE.name  # goes on where an estimator, which may give the states, stops
_MOST_AHEAD = 200_000  # messages that may wait for their states: what publishers keep, and more
_EVERY = 100  # states between two reports of how far the record has come
_REMEMBERED = 50_000  # states: a reader keeps as many messages, which may come after their states
_JOINS = 2.0  # [s] by the wall clock in which a recorder that joins a run may hear no state yet
_FLOWS = 2.0  # [s] by the wall clock after a state, within which others come
_FEW = 10  # instants beyond the last state: a stranger's stamps, or the last answers

_OWNED = {topic.name for topic in OWNED}
_QUIET = 0.3  # [s] without a message after which all that was sent has arrived
_RUNS_ON = NANOSECONDS  # after a stop; a node that still sends has not been asked to end

Write = Callable[[str, int, bytes], None]


class Recording:
    """The messages of one run, in one namespace; `write` gets topic, time [ns] and bytes.

    The time is the stamp until time begins again. Then it goes on from the last one: other tools
    read a bag by these times, and would mix what came before and after.
    """

    def __init__(self, write: Write) -> None:
        self._write = write
        self._rhythm = Rhythm(_LEAD)
        self._lanes: defaultdict[str, Lane] = defaultdict(Lane)
        self._states = self._lanes[_LEAD]
        self._origins = [0]  # [ns] where each epoch of the states begins, in times of the bag
        # What waits for its state: topic, bytes, and if it was sent ahead, by epoch and stamp [ns].
        self._ahead: dict[tuple[int, int], list[tuple[str, bytes, bool]]] = {}
        self._instants: list[tuple[int, int]] = []  # a heap of those, and of some that have passed
        self._waiting = 0  # how many messages those are
        self._end = inf  # the last state [ns], once it is known
        self._led = -inf  # when a state came, by the wall clock [s]
        self._runs_on = False  # states still came when the record ended
        self._heard = inf  # when the first message came, by the wall clock [s]
        self._latest: dict[int, None] = {}  # stamps [ns] of the latest states, and of the truth
        self._unreported = 0
        self._joined = 0  # first state [ns] that a recorder that joins a run has heard
        self._begun = False  # what is awaited has come since time began
        self._again = -inf  # when time began again, by the wall clock [s]
        self._told: dict[str, Told] = {}
        self._early: dict[str, bytes] = {}  # of time that begins again with the next state

    @property
    def now(self) -> int:
        """The newest state [ns]; -1: none has come."""
        return self._states.stretches[-1].last

    def event(self, name: str, stamp_ns: int | None, data: bytes) -> None:
        """Write a message that is no sample, at its own time or at that of the newest state.

        A zero stamp means none: orders with it act from now on.
        """
        stamp_ns = max(stamp_ns or 0, 0) or max(self.now, 0)
        self._write(name, self._origins[-1] + stamp_ns, data)

    def hear(self, name: str, stamp_ns: int | None, number: int | None, now: float) -> None:
        """Take who has sent a message that is no sample, on a topic that belongs to one node."""
        told = self._told.setdefault(name, Told(self._states.epoch))
        told.publishers.hear(number, stamp_ns or 0, now)

    def event_with_state(
        self, name: str, stamp_ns: int | None, data: bytes, number: int | None, now: float
    ) -> None:
        """Write a message that is no sample, but that its node sends with a state or its answer.

        It comes again when the state is repeated, and counts once. It may come before the state
        with which time begins again, or after that though it is of the time before. The other
        arguments are those of `sample`.
        """
        if stamp_ns is None or stamp_ns < 0:
            self.event(name, stamp_ns, data)
            return
        if stamp_ns > self._end:
            return
        topic = self._told.setdefault(name, Told(self._states.epoch))
        topic.publishers.hear(number, stamp_ns, now)
        if not topic.take(stamp_ns, data, self._states.epoch, self.now):
            return
        self._early.pop(name, None)
        if topic.epoch > self._states.epoch:
            self._early[name] = data
        elif topic.is_stamped:
            self._write(name, self._origins[topic.epoch] + stamp_ns, data)
        else:
            self.event(name, None, data)

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

        A sample that its node sends `ahead` may be of an instant that is skipped; then it is not
        recorded. The stamp [ns] is None if it cannot be read. The number is the one that the
        publisher gave the message, and None if the middleware does not tell it.
        """
        if stamp_ns is None or stamp_ns < 0:
            self.event(name, stamp_ns, data)
            return
        if stamp_ns > self._end:
            return
        if now < self._heard:
            self._heard = now
        lane = self._lanes[name]
        if lane.heard < 0:  # it has no part in the times before it came
            lane.stretches += (Stretch() for _ in range(lane.epoch, self._states.epoch))
        lane.publishers.hear(number, stamp_ns, now)
        # Time may begin again before a lane has come beyond zero: the states tell.
        behind = lane.epoch < self._states.epoch
        if stamp_ns == 0 and (lane.heard > 0 or behind):
            self._begin_again(name, lane, now)
        elif self._went_on(lane, stamp_ns):
            self._take_back(name, lane)
        lane.heard = stamp_ns
        if name == _TRUTH and lane.epoch == self._states.epoch:
            self._remember(stamp_ns)
        epoch = lane.epoch
        if (stamp_ns, data) in lane.latest:
            if name == _LEAD:  # a plant that repeats a state waits, maybe for this record alone
                self._unreported = _EVERY
            return  # or it is a peer's repeated answer to a repeated state
        lane.latest = (*lane.latest[-1:], (stamp_ns, data))
        if name == _LEAD:
            self._led = now
            self._keep(name, epoch, stamp_ns, data)
            self._lead(stamp_ns, now)
        else:
            self._place(name, epoch, stamp_ns, data, ahead)

    def _place(self, name: str, epoch: int, stamp_ns: int, data: bytes, ahead: bool) -> None:
        """Write a sample that is no state, or let it wait for its state."""
        if epoch == self._states.epoch and stamp_ns < self._joined:
            return
        if self._is_present(epoch, stamp_ns):
            if not ahead or self._has_state(epoch, stamp_ns):
                self._keep(name, epoch, stamp_ns, data)
            elif stamp_ns > self._states.heard:  # time has gone back, and not to zero
                self._wait(name, epoch, stamp_ns, data, ahead)
        elif epoch >= self._states.epoch:
            self._wait(name, epoch, stamp_ns, data, ahead)

    def _begin_again(self, name: str, lane: Lane, now: float) -> None:
        lane.begin_again()
        if name == _LEAD:
            self._origins.append(self._origins[-1] + lane.ended + 1)
            self._joined, self._begun = 0, False
            self._latest.clear()
            self._again = now
            for early, message in self._early.items():
                self._write(early, self._origins[-1], message)
            self._early.clear()

    def _went_on(self, lane: Lane, stamp_ns: int) -> bool:
        """True if a stamp [ns] shows that time never began again, though the lane had a zero."""
        is_ahead = lane is self._states or lane.epoch > self._states.epoch
        return is_ahead and lane.went_on(stamp_ns)

    def _take_back(self, name: str, lane: Lane) -> None:
        """Undo restarts: their stamps of zero were none, as of `ros2 topic pub`; time goes on."""
        epoch = lane.epoch - 1 if lane is self._states else self._states.epoch
        while lane.epoch > epoch:
            lane.surplus += lane.stretches.pop().count
        del self._origins[len(self._states.stretches) :]
        for instant in [each for each in self._ahead if each[0] > epoch]:
            strays = [each for each in self._ahead[instant] if each[0] == name]
            self._waiting -= len(strays)
            for stray in strays:
                self._ahead[instant].remove(stray)
                self._place(name, epoch, instant[1], *stray[1:])

    def _is_present(self, epoch: int, stamp_ns: int) -> bool:
        """True if the state of this instant has come, or a later one."""
        states = self._states.stretches
        return epoch < len(states) and stamp_ns <= states[epoch].last

    def _has_state(self, epoch: int, stamp_ns: int) -> bool:
        """True if an instant that has passed was a state's, as far as these are remembered."""
        oldest = next(iter(self._latest), 0)
        return epoch < self._states.epoch or stamp_ns < oldest or stamp_ns in self._latest

    def _remember(self, stamp_ns: int) -> None:
        """Remember that an instant is a state's."""
        self._latest[stamp_ns] = None
        if len(self._latest) > _REMEMBERED:
            del self._latest[next(iter(self._latest))]

    def _wait(self, name: str, epoch: int, stamp_ns: int, data: bytes, ahead: bool) -> None:
        instant = epoch, stamp_ns
        if instant not in self._ahead:
            heappush(self._instants, instant)
        waiting = self._ahead.setdefault(instant, [])
        if (name, data, ahead) in waiting:
            return
        if self._waiting >= _MOST_AHEAD:  # no run is so far ahead: no states come any more
            self._pass(instant)
        self._waiting += 1
        waiting.append((name, data, ahead))

    def _lead(self, stamp_ns: int, now: float) -> None:
        """Take a state that is written, and write the messages that were ahead of it."""
        present = self._states.epoch, stamp_ns
        # A recorder that joins a run hears answers to states that it has missed: left out.
        is_first = self._states.stretches[-1].count == 1
        if stamp_ns:  # at zero the time before may still go on, and what waits is part of it
            joins = is_first and now < self._heard + _JOINS
            self._joined = stamp_ns if joins else self._joined
            self._pass(present, joins)
        self._unreported += 1
        self._remember(stamp_ns)
        for name, data, _ in self._ahead.pop(present, ()):
            self._waiting -= 1
            self._keep(name, *present, data)

    def _pass(self, until: tuple[int, float], joins: bool = False) -> None:
        """Write what was sent at instants whose states have not come, unless the recorder `joins`.

        What was sent ahead of them is dropped, unless the truth has them.
        """
        while self._instants and self._instants[0] < until:
            first = heappop(self._instants)
            for name, data, ahead in self._ahead.pop(first, ()):
                self._waiting -= 1
                if first[0] == until[0] and not (joins or (ahead and first[1] not in self._latest)):
                    self._keep(name, *first, data)

    def _keep(self, name: str, epoch: int, stamp_ns: int, data: bytes) -> None:
        """Write a sample, and count it if it is the first one of its instant."""
        lane = self._lanes[name]
        stretch = lane.stretches[epoch]
        last = stretch.last
        if stamp_ns <= last:
            lane.surplus += 1
        else:
            if lane is self._states and stretch.count:
                self._rhythm.add(last, stamp_ns)
            stretch.count += 1
            stretch.total += stamp_ns
            stretch.last = stamp_ns
        self._write(name, self._origins[epoch] + stamp_ns, data)

    def began(self, names: Iterable[str], since: float) -> int | None:
        """First stamp [ns] of a node on its topics, if it began to send since a time [s].

        It is zero if time has begun again meanwhile.
        """
        topics = self._topics()
        newest = filter(None, (topics[name].publishers.newest for name in names if name in topics))
        begun = (stamp if at >= self._again else 0 for at, stamp in newest if at >= since)
        return min(begun, default=None)

    def end(self, now: float) -> None:
        """Ignore, from now on, messages of later instants than the newest state.

        Those that wait are later ones too, unless states have ceased to come.
        """
        self._end = self.now
        self._runs_on = now - self._led < _FLOWS

    def missing(self, awaited: Iterable[str]) -> list[str]:
        """Awaited topics that have not come since time began; none before the first state."""
        if self._begun or self.now < 0:
            return []
        come = {
            name
            for name, lane in self._lanes.items()
            if lane.epoch == self._states.epoch and lane.stretches[-1].count
        }
        return sorted({*awaited} - come)

    def progress(self, awaited: Iterable[str] = ()) -> int | None:
        """Newest recorded state [ns], now and then, so that a plant that waits may go on; or None.

        It is told for the first time as soon as all awaited topics have come. After a repeated
        state it is told at once, because the plant may still wait for an earlier recorder that was
        killed, and then sends no new state to this one.
        """
        if not self._begun and self.now >= 0 and not self.missing(awaited):
            self._begun, self._unreported = True, _EVERY
        if not self._begun or self._unreported < _EVERY:
            return None
        self._unreported = 0
        return self.now

    def gaps(self, expected: Iterable[str]) -> list[str]:
        """Describe, at the end, what is missing or came from several nodes; empty if nothing is.

        The expected topics must have come, once a state has been answered. A run that is stopped
        may lack the answers to its last state. After a reset of the plant time begins again, and
        what came before is compared by itself.
        """
        states = self._states.stretches
        if self.now >= 0 and len(self._ahead) > _FEW and not self._runs_on:
            # States come no more, and others go on.
            self._pass((self._states.epoch, inf))
        written = {
            name: lane.stretches
            for name, lane in self._lanes.items()
            if any(each.count for each in lane.stretches)
        }
        found = self._rhythm.jumps() if _LEAD in written else [f"{_LEAD} never came"]
        if self._states.epoch or states[0].count > 1:
            found += [f"{name} never came" for name in expected if name not in written]
        for name, stretches in written.items():
            for own, led in zip_longest(stretches, states, fillvalue=Stretch()):
                end = min(own.last, led.last)
                if own.until(end) != led.until(end):
                    found.append(
                        f"{name} has {own.count} messages until {own.end}, "
                        f"{_LEAD} {led.count} until {led.end}"
                    )
        return found + [
            f"{name} came from several nodes: {topic.publishers.nodes}"
            for name, topic in self._topics().items()
            if topic.came_from_several and (name in self._lanes or name in _OWNED)
        ]

    def _topics(self) -> dict[str, Told | Lane]:
        return {**self._told, **self._lanes}

    def see(self, name: str, nodes: Mapping[Hashable, str], now: float) -> None:
        """Take the nodes that publish on a topic, as the graph shows them (`Publishers.see`)."""
        if topic := self._topics().get(name):
            topic.publishers.see(nodes, now)

    def unnumbered(self) -> bool:
        """True if messages came without a number of their publisher (`Publishers.unnumbered`)."""
        return any(lane.publishers.unnumbered for lane in self._lanes.values())

    def surplus(self) -> dict[str, int]:
        """How many messages of each topic came beside the first one of their instant."""
        return {name: lane.surplus for name, lane in self._lanes.items() if lane.surplus}


class Drain:
    """Tells when a record that is to end has all that was sent before; `now` is in s."""

    def __init__(self, now: float, wall_ns: int) -> None:
        self._heard = now
        self._late = wall_ns + _RUNS_ON
        self._end = inf

    def goes_on(self, now: float, heard: float) -> bool:
        """True until no message has come for a while, or soon after the stack was seen to run on.

        The last message was `heard` then [s].
        """
        return now < min(max(self._heard, heard) + _QUIET, self._end)

    def runs_on(self, now: float, sent_ns: int) -> bool:
        """True once: when the latest message was sent long after the stop [ns of the wall clock].

        The record of a stack that runs on ends with the newest state.
        """
        if self._end < inf or sent_ns <= self._late:
            return False
        self._end = now + _QUIET
        return True
