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

"""Torques that anyone injects: accepted or refused, and acting from a stamp on that can be told."""

from collections.abc import Callable, Sequence
from typing import Any

from ppc_attitude.runtime.stamps import RefusedError
from ppc_attitude.science.stamps import seconds

_MOST = 1000  # pulses that may be pending or active at a time
_REMEMBERED = 100  # requests whose answers are kept for who asks again

Pulse = Any  # array of one record with `start_ns` and `end_ns` [ns]


class Injections:
    """Pulses that are injected into a run, made from start [ns], duration [s] and torque [N·m]."""

    def __init__(self, pulse: Callable[[int, float, Sequence[float]], Pulse]) -> None:
        self._pulse = pulse
        self._pulses: list[Pulse] = []
        # Duration [s] and torque [N·m] of what acts from the next instant on.
        self._beginning: list[tuple[float, tuple[float, ...]]] = []
        self._changed = False
        self._stamp = -1  # the latest instant [ns] that was asked for
        self._answers: dict[str, str] = {}  # to requests that have a name
        self.accepted = 0

    def accept(
        self,
        torque: tuple[float, ...],
        start_ns: int,
        duration: float,
        limit: float,
        next_ns: int | None,
        request: str = "",
    ) -> str:
        """Take a torque [N·m], body axes; say in words from when to when it acts.

        It acts for a duration [s]. What would begin in the past [ns] begins now: at `next_ns`, the
        first stamp whose torque has not been sent, as far as that is known. Who asks again by the
        name of a request gets its answer, and no torque more.

        Raises
        ------
        RefusedError
            The torque is larger than the limit per axis [N·m], or too many pulses are pending.
        """
        if request in self._answers:
            return self._answers[request]
        if max(map(abs, torque)) > limit:
            allowed = f"up to {limit} N·m per axis (max_injected_torque)"
            raise RefusedError(f"torque = {torque} N·m; allowed: {allowed}")
        self._pulses = [each for each in self._pulses if each["end_ns"][0] > self._stamp]
        if self.pending >= _MOST:
            raise RefusedError(f"{_MOST} pulses are pending already")
        self.accepted += 1
        begin = next_ns
        if start_ns > max(self._stamp, 0):
            begin = start_ns
            self._pulses.append(self._pulse(start_ns, duration, torque))
            self._changed = True
        else:
            self._beginning.append((duration, torque))
        text = f"{torque} N·m acts from the next state on for {duration:g} s"
        if begin is not None:
            end = seconds(begin) + duration
            text = f"{torque} N·m acts from t = {seconds(begin):.6f} s to {end:.6f} s"
        if request:
            self._answers[request] = text
            if len(self._answers) > _REMEMBERED:
                del self._answers[next(iter(self._answers))]
        return text

    def at(self, stamp_ns: int) -> list[Pulse] | None:
        """Begin the pulses that wait for the next instant [ns]; return all if they have changed."""
        self._stamp = stamp_ns
        if self._beginning:
            self._pulses += [self._pulse(stamp_ns, *each) for each in self._beginning]
            self._beginning.clear()
        elif not self._changed:
            return None
        self._changed = False
        return self._pulses

    def begin_again(self) -> None:
        """Forget the torques that were injected before time began again, and who asked for them."""
        self._pulses.clear()
        self._answers.clear()
        self._changed = True
        self._stamp = -1

    @property
    def pending(self) -> int:
        """How many pulses act or will act."""
        return len(self._pulses) + len(self._beginning)
