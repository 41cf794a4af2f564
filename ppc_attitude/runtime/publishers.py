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

"""Is there one publisher on a topic, as the contract wants it? Judged by what is sent."""

from ppc_attitude.science.stamps import NANOSECONDS

_RETURNS = 20  # so many returns to a publisher that another had followed make two that live
_LARGEST_STEP = NANOSECONDS
_HEARD = 5.0  # [s] after its last message a second publisher counts as gone
_MOST = 8  # publishers of one topic that are told apart


class _Publisher:
    """The latest message of one publisher."""

    __slots__ = ("advances", "number", "stamp_ns")

    def __init__(self, number: int, stamp_ns: int) -> None:
        self.number = number
        self.stamp_ns = stamp_ns
        self.advances = False  # its stamp followed that of the one before


class Publishers:
    """Tell apart who publishes on one topic, by the numbers that each gives to its messages.

    A node that was killed stays in the ROS graph for a while, and one that was restarted has its
    name. So the graph alone is no proof. Every publisher counts its messages: a new one begins to
    count anew, and two that live are known by returns to a count that another had followed. A
    return counts if the stamps of both advance as time does: bad messages make no publisher.
    """

    def __init__(self) -> None:
        self._known: list[_Publisher] = []  # the one that spoke last first
        self._turned = False
        self._returns = 0
        self._returned_at = 0.0

    def hear(self, number: int, stamp_ns: int, now: float) -> None:
        """Take the number that a publisher gave to a message, and the stamp [ns] in it."""
        known = self._known
        if not known or known[0].number != number - 1:  # else who spoke last speaks on
            self._turn_to(number, stamp_ns)
        speaker = known[0]
        before = speaker.stamp_ns
        speaker.advances = before >= 0 and 0 < stamp_ns - before <= _LARGEST_STEP
        if self._turned:
            self._turned = False
            if speaker.advances and known[1].advances:
                self._returns += 1
                self._returned_at = now
        speaker.number, speaker.stamp_ns = number, stamp_ns

    def _turn_to(self, number: int, stamp_ns: int) -> None:
        """Put first who gave this number: one who is known, or a new one."""
        known = self._known
        for place, publisher in enumerate(known):
            if publisher.number == number - 1:
                known.insert(0, known.pop(place))
                self._turned = True
                return
        # A message was lost: its publisher is the one that spoke last, unless that had got further.
        if not known or number <= known[0].number:
            known.insert(0, _Publisher(number, stamp_ns))
            del known[_MOST:]

    @property
    def several(self) -> bool:
        """True if more than one publisher has sent messages in turns with another."""
        return self._returns >= _RETURNS

    def lasts(self, now: float) -> bool:
        """True if they still do."""
        return self.several and now - self._returned_at < _HEARD
