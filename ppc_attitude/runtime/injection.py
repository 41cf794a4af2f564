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

"""Torques that anyone injects: refused, or accepted with the stamps between which they act."""

from typing import Any

from ppc_attitude.runtime.stamps import RefusedError
from ppc_attitude.science.disturbances.pulses import pulse
from ppc_attitude.science.stamps import ROUNDING, instant, nanoseconds, seconds

_MOST = 1000  # pulses that may be pending or active at a time
_REMEMBERED = 100  # requests whose answers are kept in case a request is repeated


class Injections:
    """Pulses that are injected into a run.

    Attributes
    ----------
    pulses : list of array of dtype `PULSE`
        Pulses whose start is known, one in each array.
    accepted : int
        How many were accepted.
    """

    def __init__(self) -> None:
        self.pulses: list[Any] = []
        # Duration [s] and torque [N·m] of what acts from the next instant on.
        self._beginning: list[tuple[float, tuple[float, ...]]] = []
        self._changed = False
        self._stamp = 0  # the latest instant [ns] that was asked for
        self._answers: dict[str, str] = {}  # to requests that have a name
        self.accepted = 0

    def accept(
        self,
        torque: tuple[float, ...],
        start_ns: int,
        duration: float,
        limit: float,
        next_ns: int | None,
        period_ns: int,
        request: str = "",
    ) -> str:
        """Take a torque [N·m], body axes; say in words from when to when it acts.

        It acts for a duration [s]. If the start [ns] is past, it begins now: at `next_ns`, the
        first stamp whose torque has not been sent, None if that is not known. A torque acts from
        stamp to stamp; if their period [ns] is known (not 0), the answer tells from which to which.
        A repeated request, recognised by its name, gets the same answer, and adds no torque.

        Raises
        ------
        RefusedError
            The torque is larger than the limit per axis [N·m], or would act at no stamp, or too
            many pulses are pending.
        """
        if request in self._answers:
            return self._answers[request]
        if max(map(abs, torque)) > limit:
            allowed = f"up to {limit} N·m per axis (max_injected_torque)"
            raise RefusedError(f"torque = {torque} N·m; allowed: {allowed}")
        self.pulses = [each for each in self.pulses if each["end_ns"][0] > self._stamp]
        if self.pending >= _MOST:
            raise RefusedError(f"{_MOST} pulses are pending or active; allowed: no more")
        begin = start_ns if start_ns > self._stamp else next_ns
        text = f"{torque} N·m acts from the next state on for {duration:g} s"
        if begin is not None:
            end = begin + nanoseconds(duration)
            if next_ns is not None and period_ns:
                begin, end = (at + (next_ns - at) % period_ns for at in (begin, end))
                if begin == end:
                    raise RefusedError(
                        f"start = {instant(seconds(start_ns))} s and duration = {duration:g} s: no "
                        f"state lies between; allowed: a duration ≥ {seconds(period_ns)} s"
                    )
            text = f"{torque} N·m acts from t = {seconds(begin):.6f} s to {seconds(end):.6f} s"
        self.accepted += 1
        if start_ns > self._stamp:
            self._add(start_ns, duration, torque)
        else:
            self._beginning.append((duration, torque))
        if request:
            self._answers[request] = text
            if len(self._answers) > _REMEMBERED:
                del self._answers[next(iter(self._answers))]
        return text

    def _add(self, start_ns: int, duration: float, torque: tuple[float, ...]) -> None:
        end_ns = start_ns + max(nanoseconds(duration) - ROUNDING, 1)
        self.pulses.append(pulse(start_ns, end_ns, torque))
        self._changed = True

    def at(self, stamp_ns: int) -> bool:
        """Begin the pulses that wait for the next instant [ns]; True if the pulses have changed."""
        self._stamp = stamp_ns
        for each in self._beginning:
            self._add(stamp_ns, *each)
        self._beginning.clear()
        changed, self._changed = self._changed, False
        return changed

    def begin_again(self) -> None:
        """Forget the torques and the requests of the time before time began again."""
        self.pulses.clear()
        self._beginning.clear()
        self._answers.clear()
        self._changed = True
        self._stamp = 0

    @property
    def pending(self) -> int:
        """How many pulses act or will act."""
        return len(self.pulses) + len(self._beginning)
