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

"""Judge by the messages of a topic whether it has one publisher, as the contract wants."""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass

from ppc_attitude.science.stamps import NANOSECONDS

_ENOUGH = 20  # messages in turns with another's that prove two publishers alive
_MOST_AT_ONCE = 5  # of them that one return to a count proves: a single return may be an error
_LARGEST_STEP = NANOSECONDS  # from stamp to stamp: no plant runs at less than 1 Hz
_REPEATS = 0.5  # [s] after which a stamp may come again: a flood of copies proves nothing
_HEARD = 5.0  # [s] after its last message a second publisher counts as gone
_NEW = 10.0  # [s] a node that was older than this when another came never gives way
_TOLD = 3.0  # [s] from the proof on until everybody else has had time to find both and hear as much
_MOST = 8  # publishers of one topic that are told apart
_LASTS = 30.0  # [s] after which a killed publisher has left the graph, so several are alive


@dataclass(slots=True)
class _Publisher:
    """The latest messages of one publisher."""

    number: int
    stamp_ns: int
    at: float  # when it last spoke [s]
    stretch: int = 0  # good messages since another one spoke


class Publishers:
    """Tells apart the publishers of one topic, by the numbers that each gives to its messages.

    A node that was killed stays in the ROS graph for a while, and one that was restarted has its
    name. So the graph alone is no proof; it only gives the names. Every publisher counts its
    messages, and a new one begins to count anew. So two are alive if the messages return to an
    earlier publisher's count after another's. A return proves more if the stretches before and
    after it are long, because a busy machine delivers in bursts. A message counts only if its stamp
    advances as time does, or is repeated after a while, as by a plant whose peers follow another
    plant. So bad messages prove no publisher.
    """

    def __init__(self) -> None:
        self.newest: tuple[float, int] | None = None
        """When the one that came last first spoke, by the wall clock [s], and its stamp [ns]."""
        self.unnumbered = False
        """True if messages came without a number: then nobody can tell several publishers."""
        self._known: list[_Publisher] = []  # the one that spoke last first
        self._proof = 0
        self._proved_at = self._last_proof = 0.0
        self._nodes: dict[Hashable, str] = {}
        self._since: dict[Hashable, float] = {}  # when each in the graph was first seen [s]
        self.stay = False
        """True if several were in the graph for so long that all of them live, if silently."""
        self._seen_at: float | None = None

    def see(self, nodes: Mapping[Hashable, str], now: float) -> None:
        """Take the publishers that the graph shows, with the names of their nodes.

        A name is empty where the graph does not know it yet.
        The names of several are kept, because the node that gives way soon leaves the graph.
        """
        self._since = {key: self._since.get(key, now) for key in nodes}
        if len(nodes) > 1:
            self.stay |= now - sorted(self._since.values())[1] >= _LASTS
            self._seen_at = now if self._seen_at is None else self._seen_at
            self._nodes = {key: name or self._nodes.get(key, "") for key, name in nodes.items()}
        elif not self.lasts(now):
            self._seen_at = None  # the other has gone, for example killed: the next one is new

    @property
    def nodes(self) -> str:
        """Names of those that were in the graph together."""
        names = sorted(name or "a node without a name" for name in self._nodes.values())
        return ", ".join(names) or "nodes that have ended"

    def hear(self, number: int | None, stamp_ns: int, now: float) -> None:
        """Take the number that a publisher gave to a message, and the stamp [ns] in it.

        Not every middleware tells the number; without it a message proves nothing.
        """
        if number is None:
            self.unnumbered = True
            return
        known = self._known
        goes_on = bool(known) and known[0].number == number - 1  # from the one that spoke last
        turned = not goes_on and self._turn_to(number, stamp_ns, now)
        speaker = known[0]
        before = speaker.stamp_ns
        repeats = stamp_ns == before and now - speaker.at >= _REPEATS
        advances = before >= 0 and (0 < stamp_ns - before <= _LARGEST_STEP or repeats)
        if turned:
            if not self.several:
                self._proved_at = now
            self._proof += min(speaker.stretch, known[1].stretch, _MOST_AT_ONCE)
            self._last_proof = now
            speaker.stretch = 0
        speaker.stretch += advances
        speaker.number, speaker.stamp_ns, speaker.at = number, stamp_ns, now

    def _turn_to(self, number: int, stamp_ns: int, now: float) -> bool:
        """Put first the publisher of this number; True if it was known, False if it is new."""
        known = self._known
        for place, publisher in enumerate(known):
            if publisher.number == number - 1:
                known.insert(0, known.pop(place))
                return True
        # A message was lost: its publisher is the one that spoke last, unless that had got further.
        if not known or number <= known[0].number:
            known.insert(0, _Publisher(number, stamp_ns, now))
            self.newest = now, stamp_ns
            del known[_MOST:]
        return False

    @property
    def several(self) -> bool:
        """True if more than one publisher has sent messages in turns with another."""
        return self._proof >= _ENOUGH

    def lasts(self, now: float) -> bool:
        """True if they still do."""
        return self.several and now - self._last_proof < _HEARD

    def gives_way(self, born: float, now: float) -> bool:
        """True if a node that publishes since a time [s] has to leave the topic to the other.

        A node that was new when the graph first showed several gives way, as soon as all other
        listeners have had time to hear enough of both.
        """
        new = self._seen_at is not None and self._seen_at - born < _NEW
        return new and self.several and now - self._proved_at >= _TOLD
