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

"""The pace of the plant: when it steps, what it holds, what it repeats, and when it gives zero.

`Lockstep` steps when what it waits for has come with the stamp of the present state,
`FreeRunning` on the wall clock. Neither knows what a craft is or how messages travel: they move a
`Craft`, which computes and publishes.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from ppc_attitude.contract.topics import RECORDED_TOPIC
from ppc_attitude.runtime.health import OK, STALE, WARN, Status
from ppc_attitude.runtime.stamps import RefusedError, Values, out_of_order
from ppc_attitude.science.stamps import ROUNDING, seconds, stamp_of, step_of

_REPEAT_FIRST, _REPEAT_MOST = 0.2, 1.0  # [s] unanswered states are repeated after this
_REBASE = 0.5  # [s] a pace that is later than this goes on from now instead of catching up
_LOOK = 0.1  # [s] longest time between two looks at the clock
_LAG = 500  # steps that lock-step may be ahead of a recorder, which has to search what waits for it
_LONG = 1.0  # [s] a longer wait is reported


class Craft(Protocol):
    """The craft whose time a pace moves."""

    def begin(self) -> None:
        """Take the initial state at time zero."""

    def act(self, stamp_ns: int, inputs: Mapping[str, Values]) -> None:
        """Hold the inputs from a stamp [ns] on."""

    def move_to(self, stamp_ns: int) -> None:
        """Reach the next stamp [ns]."""

    def show(self) -> None:
        """Publish the present state."""

    def tell_acted(self) -> None:
        """Publish the torque that acted last."""

    def is_published(self, name: str) -> bool:
        """True if anybody publishes on a topic."""

    def complain(self, kind: str, text: str) -> None:
        """Warn the user, but not each time that this is called."""

    def announce(self, text: str, warning: bool) -> None:
        """Tell the user that something has changed."""


@dataclass
class Rules:
    """How a plant is paced."""

    rate: float  # steps per second of simulated time [Hz]
    last_step: int | None  # at which the plant ends; None: never
    inputs: Mapping[str, Values]  # name and zero value; the first is the command, which must come
    wait_for: tuple[str, ...]  # lock-step waits for these; free-running at the beginning only
    waits: bool  # for a recorder; free-running: time begins with the first answer
    factor: float = 0.0  # lock-step: simulated seconds per second; 0: as fast as possible
    timeout_ns: int = 0  # an input that is older than this is zero

    @property
    def command(self) -> str:
        """Name of the input that must come."""
        return next(iter(self.inputs))


@dataclass
class _Input:
    """Latest values of one input, and the first ones that came early for the next instant."""

    values: Values
    stamp: int = -1
    early: Values | None = None


class Pace(ABC):
    """The base of both ways: the present instant, and the inputs that have come for it.

    All rules but those about the rate may change at any time. In every call `now` is the time of
    the wall clock [s].
    """

    mode = ""

    def __init__(self, craft: Craft, rules: Rules, now: float) -> None:
        self.craft = craft
        self.rules = rules
        self.begin(now)

    def begin(self, now: float) -> None:
        """Begin at time zero."""
        self.step = self.stamp = 0
        self.following = stamp_of(1, self.rules.rate)
        self.finished = False
        self.overruns = self.late_commands = 0
        self.inputs = {name: _Input(zero) for name, zero in self.rules.inputs.items()}
        self.waiting_since = self._sent_at = self._origin = now
        self._repeat_after = _REPEAT_FIRST
        self._timed_out: set[str] = set()  # inputs that are zero because they are too old
        self._shown = False  # the present state has been published
        self._repeated: tuple[int, ...] = ()  # stamps [ns] that may be answered twice
        # With a recorder, time stays at the first state until the recorder tells that it has this
        # state and the answers of every node: the recorder, or a node that none reads, may be late.
        self._recorded = -_LAG - 1 if self.rules.waits else None
        self.craft.begin()

    def take(self, name: str, stamp_ns: int, values: Values, now: float) -> bool:
        """Take a message of an input; True if `wake` has to be called.

        Raises
        ------
        RefusedError
            The stamp is out of order, or beyond the next instant.
        """
        stream = self.inputs[name]
        if stamp_ns > self.stamp:
            if stamp_ns != self.following:
                raise RefusedError(
                    f"{name}: stamp {seconds(stamp_ns):.6f} s is in the future; the present state "
                    f"has {seconds(self.stamp):.6f} s"
                )
            stream.early = stream.early or values
            return False
        if stamp_ns < stream.stamp and stamp_ns not in self._repeated:
            raise out_of_order(name, stamp_ns)
        # One of the same stamp is a peer's repeated answer.
        return stamp_ns > stream.stamp and self._accept(stream, stamp_ns, values, now)

    def record(self, stamp_ns: int, now: float) -> None:
        """Learn up to which stamp [ns] the recorder has written; then `wake` has to be called.

        Lock-step waits for it always, free-running at the first state only.
        """
        self._recorded = step_of(stamp_ns, self.rules.rate)

    def _lags(self) -> bool:
        return self._recorded is not None and self.step - self._recorded > _LAG

    def _has_gone(self) -> bool:
        """Whether the recorder that time waits for has gone; then time waits for it no longer."""
        gone = self._lags() and not self.craft.is_published(RECORDED_TOPIC.name)
        if gone:
            self._recorded = None
            told = f"the recorder has gone: no wait for it from t = {seconds(self.stamp):.3f} s on"
            self.craft.announce(told, warning=True)
        return gone

    @abstractmethod
    def wake(self, now: float) -> float:
        """Do what is due; return the time [s] until the next call."""

    @abstractmethod
    def _accept(self, stream: _Input, stamp_ns: int, values: Values, now: float) -> bool:
        """Take a message that is not of the future; True if `wake` has to be called."""

    @abstractmethod
    def _missing(self) -> list[str]:
        """Inputs without which time does not go on, and that have not come."""

    def waiting(self) -> str:
        """The inputs that are waited for, in words, or the recorder; empty if nothing is."""
        missing = self._missing()
        if not missing:
            told = f"waiting at t = {seconds(self.stamp):.3f} s for the recorder to follow"
            return told if self._lags() else ""
        absent = [name for name in missing if not self.craft.is_published(name)]
        text = f"waiting at t = {seconds(self.stamp):.3f} s for {', '.join(missing)}"
        if absent:
            text += f"; nobody publishes {', '.join(absent)}"
        return text + "".join(self._last(name) for name in missing if name not in absent)

    def _last(self, name: str) -> str:
        """Tell an input's last stamp: its peer is silent, or does not copy the states' stamps."""
        stamp_ns = self.inputs[name].stamp
        told = f"; the last {name} has the stamp {seconds(stamp_ns):.3f} s"
        return told if stamp_ns >= 0 else ""

    def _show(self, now: float) -> None:
        self.craft.show()
        self._shown = True
        self._sent_at = now

    def _advance(self, inputs: Mapping[str, Values], show: bool, now: float) -> None:
        """Hold inputs until the next stamp; publish the torque, and with `show` the new state.

        The state goes last: peers that it wakes take the processor from what is still to be sent.
        """
        self.craft.act(self.stamp, inputs)
        self.finished = self.step == self.rules.last_step
        if not self.finished:
            self.step += 1
            self.stamp, self.following = self.following, stamp_of(self.step + 1, self.rules.rate)
            for stream in self.inputs.values():
                if stream.early:
                    stream.stamp, stream.values, stream.early = self.stamp, stream.early, None
            self.craft.move_to(self.stamp)
            self.waiting_since = now
            self._repeat_after = _REPEAT_FIRST
            self._shown = False
        self.craft.tell_acted()
        if show and not self.finished:
            self._show(now)

    def _repeat(self, now: float) -> float:
        """Repeat a state that stays unanswered."""
        if now - self._sent_at >= self._repeat_after:
            self._show(now)
            self._repeated = self.stamp, self.following  # which may have been sent ahead
            self._repeat_after = min(2.0 * self._repeat_after, _REPEAT_MOST)
        return _LOOK

    def _fresh(self, name: str) -> Values:
        """Latest values of an input, or zero when they are older than the time-out."""
        stamp = self.inputs[name].stamp
        expected = stamp >= 0 or name == self.rules.command  # the others need not be there
        timed_out = expected and self.stamp - max(stamp, 0) > self.rules.timeout_ns + ROUNDING
        if timed_out != (name in self._timed_out):
            self._timed_out ^= {name}
            when = f"t = {seconds(self.stamp):.3f} s"
            timeout = seconds(self.rules.timeout_ns)
            text = f"{name} is back at {when}"
            if timed_out:
                text = f"no {name} for {timeout:g} s: zero torque from {when}{self._last(name)}"
            self.craft.announce(text, warning=timed_out)
        return self.rules.inputs[name] if timed_out else self.inputs[name].values

    def status(self, now: float) -> tuple[bytes, str]:
        """Waiting, zero torque for lack of an input, or running."""
        if now - self.waiting_since > _LONG and self.waiting():
            return STALE, self.waiting()
        if self._timed_out:
            return WARN, f"no {', '.join(sorted(self._timed_out))}: zero torque"
        return OK, "running"

    def report(self, now: float) -> Status:
        """Status with its numbers."""
        details = {
            "steps": self.step,
            "rate [Hz]": self.rules.rate,
            "mode": self.mode,
            "overruns": self.overruns,
            "late commands": self.late_commands,
        }
        return Status(*self.status(now), details)


class Lockstep(Pace):
    """Step when every input that is waited for has come, and no recorder lags."""

    mode = "lock-step"

    def begin(self, now: float) -> None:
        """Begin at time zero."""
        self._factor, self._first = self.rules.factor, 0
        super().begin(now)

    def record(self, stamp_ns: int, now: float) -> None:
        """Go on if it was waited for."""
        super().record(stamp_ns, now)
        self._go(now)

    def _missing(self) -> list[str]:
        """Which inputs have not come for the present instant."""
        return [name for name in self.rules.wait_for if self.inputs[name].stamp != self.stamp]

    def _accept(self, stream: _Input, stamp_ns: int, values: Values, now: float) -> bool:
        if stamp_ns == self.stamp:  # else it was sent before its peer saw this state
            stream.stamp, stream.values = stamp_ns, values
            self._go(now)
        return not self._shown

    def _go(self, now: float) -> None:
        while self._shown and not (self.finished or self._missing() or self._lags()):
            values = {name: self._fresh(name) for name in self.inputs}
            self._advance(values, show=self._ahead(now, self.following) <= 0.0, now=now)

    def _ahead(self, now: float, stamp_ns: int) -> float:
        """Seconds by which a stamp [ns] is ahead of the pace that is asked for.

        The pace counts from the stamp at which it was chosen or a long wait ended: so time neither
        catches up nor stands still because it went slower or faster before.
        """
        if self.rules.factor != self._factor:
            self._factor, self._first, self._origin = self.rules.factor, self.stamp, now
        if not self._factor:
            return 0.0
        ahead = seconds(stamp_ns - self._first) / self._factor - (now - self._origin)
        if ahead < -_REBASE:
            self._first, self._origin = stamp_ns, now
        return ahead

    def wake(self, now: float) -> float:
        """Publish a state that was too early, or repeat one that is unanswered."""
        if self._has_gone():
            self._go(now)
        ahead = self._ahead(now, self.stamp)
        if ahead > 0.0:
            self.waiting_since = now  # until then it waits for the clock alone
            return min(ahead, _LOOK)
        if not self._shown:
            self._show(now)
            self.waiting_since = now
            self._go(now)
        return self._repeat(now) if self._shown else 0.0


class FreeRunning(Pace):
    """Step on the wall clock and hold the last inputs; one that is too old becomes zero."""

    mode = "free-running"

    def begin(self, now: float) -> None:
        """Begin at time zero."""
        self._held = self.rules.inputs[self.rules.command]  # acts since the latest state
        super().begin(now)

    def record(self, stamp_ns: int, now: float) -> None:
        """Begin, if it was waited for."""
        if self._awaits_recorder():
            self._origin = now
        super().record(stamp_ns, now)

    def _awaits_recorder(self) -> bool:
        return self.step == 0 and self._lags()

    def _accept(self, stream: _Input, stamp_ns: int, values: Values, now: float) -> bool:
        awaited = bool(self._missing())
        stream.stamp, stream.values = stamp_ns, values
        if awaited:
            self._origin = now  # time begins when every awaited input has come once
        return awaited

    def _missing(self) -> list[str]:
        """Return which first answers have not come, if time begins with them."""
        if not self.rules.waits:
            return []
        return [name for name in self.rules.wait_for if self.inputs[name].stamp < 0]

    def wake(self, now: float) -> float:
        """Step when it is time."""
        if not self._shown:
            self._show(now)
            self._origin = self.waiting_since = now
        if self.step == 0 and self._has_gone():
            self._origin = now
        if self._missing() or self._awaits_recorder():
            return self._repeat(now)
        # The present state was published at origin + stamp; the next one is due a period later.
        late = now - self._origin - seconds(self.following)
        if late < 0.0:
            return min(-late, _LOOK)
        if late > _REBASE:
            text = f"paused for {late:.2f} s: simulated time goes on from now"
            self.craft.complain("pause", text)
            self._origin += late
            self.overruns += 1
        elif late > 1.0 / self.rules.rate:
            self.overruns += 1
            self.craft.complain("overrun", f"step {self.step} is {1e3 * late:.1f} ms late")
        command = self.rules.command
        self.late_commands += self.inputs[command].stamp < self.stamp
        values = {name: self._fresh(name) for name in self.inputs if name != command}
        self._advance({command: self._held, **values}, show=True, now=now)
        # The command for this new state is still to come: what arrived last acts, a sample late.
        self._held = self._fresh(command)
        return 0.0
