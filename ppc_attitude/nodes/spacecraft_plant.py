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

"""The plant: integrates the rigid body, publishes its state, and owns simulated time."""

import sys
import time
from collections.abc import Mapping
from typing import Any

from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from ppc_attitude.contract.cdr import encode_clock, seconds, stamp_of
from ppc_attitude.contract.parameters import WAIT_FOR_RECORDER
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    APPLIED_TORQUE,
    ATTITUDE,
    CLOCK_TOPIC,
    DISTURBANCE,
    PLANT,
    TORQUE_COMMAND,
)
from ppc_attitude.nodes.base import BaseNode
from ppc_attitude.nodes.health import ERROR, OK, STALE, WARN
from ppc_attitude.nodes.messages import LARGEST, RefusedError, out_of_order
from ppc_attitude.nodes.qos import published
from ppc_attitude.nodes.rival import RivalWatch
from ppc_attitude.nodes.running import run_node
from ppc_attitude.science.kernel import Vector, one
from ppc_attitude.science.parameter import Value
from ppc_attitude.science.spacecraft import advance, sensed
from ppc_attitude.simulation.scenario import initial_state, nanoseconds, plant_record

_ZERO: Vector = (0.0, 0.0, 0.0)
_REPEAT_FIRST, _REPEAT_MOST = 0.2, 1.0  # [s] unanswered states are repeated after this
_REBASE = 0.5  # [s] a plant that is later than this goes on from now instead of catching up
_PROGRESS_PERIOD = 0.1  # [s]
_ACKNOWLEDGED_EVERY = 2500  # steps; publishers remember twice as many (`qos`)
_LAG_PATIENCE = 15.0  # [s] how long lock-step waits for a subscriber that lags


class SpacecraftPlant(BaseNode):
    """Rigid body and actuator; free-running on the wall clock, or in lock-step with its inputs."""

    executable = PLANT

    def __init__(self, progress: bool = False) -> None:
        super().__init__()
        values = self.parameters
        self._lockstep = bool(values["lockstep"])
        self._rate = float(values["rate"])
        self._last_step = round(values["duration"] * self._rate) if values["duration"] else None
        self._progress = _PROGRESS_PERIOD if progress else None
        self._inputs = {TORQUE_COMMAND.name: _ZERO, DISTURBANCE.name: _ZERO}
        self._input_stamps = dict.fromkeys(self._inputs, -1)
        self._apply_parameters()

        self._clock_publisher = self.create_publisher(
            Clock, CLOCK_TOPIC.name, published(CLOCK_TOPIC)
        )
        self._send_attitude = self.sender(ATTITUDE)
        self._send_rate = self.sender(ANGULAR_VELOCITY)
        self._send_applied = self.sender(APPLIED_TORQUE)
        for topic in (TORQUE_COMMAND, DISTURBANCE):
            self.listen(topic, self._receiver(topic.name))
        self.create_service(Trigger, "~/reset", self._on_reset)
        self._rival = RivalWatch(self, ATTITUDE)
        self._begin()

    def check(self, values: Mapping[str, Value]) -> None:
        """See that inertia, torque limits and initial attitude are possible."""
        plant_record(values)

    def _apply_parameters(self) -> None:
        self._plant = one(plant_record(self.parameters.values))
        self._wait_for = tuple(self.parameters["wait_for"])
        self._timeout_ns = nanoseconds(self.parameters["command_timeout"])
        self.parameters.changed = False

    def _begin(self) -> None:
        """Set the initial state at time zero."""
        self._step = 0
        self._stamp = 0
        self._q, self._omega = initial_state(self.parameters.values)
        for name in self._inputs:
            self._inputs[name] = _ZERO
            self._input_stamps[name] = -1
        self._held = _ZERO  # free-running: what acts since the latest state
        self._overruns = 0
        self._late_commands = 0
        self._timed_out: set[str] = set()  # free-running: inputs that are missing
        self._started = False  # the present state has been published
        self._waiting_since = self._last_sent = time.monotonic()
        self._repeat_after = _REPEAT_FIRST
        self._origin = time.monotonic()
        self._shown = 0.0
        self.restart_report()

    def _receiver(self, name: str) -> Any:
        def receive(stamp_ns: int, values: tuple[float, ...]) -> None:
            if stamp_ns > self._stamp:
                raise RefusedError(
                    f"{name}: stamp {seconds(stamp_ns):.6f} s is in the future of "
                    f"{seconds(self._stamp):.6f} s"
                )
            if stamp_ns <= self._input_stamps[name]:
                if stamp_ns < self._input_stamps[name]:
                    raise out_of_order(name, stamp_ns)
                return  # a peer's repeated answer
            if self._lockstep and stamp_ns < self._stamp:
                return  # an answer to an earlier state, sent before its peer saw this one
            awaited = self._awaits_first_answer()
            self._inputs[name] = (values[0], values[1], values[2])
            self._input_stamps[name] = stamp_ns
            if self._lockstep:
                self._step_if_complete()
            elif awaited:
                self._origin = time.monotonic()  # time begins with the last first answer
                self.wake_now()

        return receive

    def _publish_state(self) -> None:
        self._clock_publisher.handle.publish_raw(encode_clock(self._stamp))
        q, omega = sensed(self._plant, self._q, self._omega, self._step)
        self._send_attitude(self._stamp, q)
        self._send_rate(self._stamp, omega)
        self._rival.sent(self._stamp)
        self._started = True

    def _advance(self, command: Vector, disturbance: Vector) -> None:
        """Hold both torques until the next stamp, publish what acted and the new state."""
        stamp, following = self._stamp, stamp_of(self._step + 1, self._rate)
        applied, q, omega = advance(
            self._plant, self._q, self._omega, command, disturbance, seconds(following - stamp)
        )
        if self._step == self._last_step:
            self._send_applied(stamp, applied)
            self.finished = True
            return
        self._step += 1
        self._stamp, self._q, self._omega = following, q, omega
        if not sum(map(abs, self._omega)) <= LARGEST:  # NaN is not either
            reason = f"diverged: angular velocity {self._omega} rad/s at {seconds(stamp)} s"
            self.fail(self._stamp, reason)
            return
        if self.parameters.changed:
            self._apply_parameters()
        self._waiting_since = self._last_sent = time.monotonic()
        self._repeat_after = _REPEAT_FIRST
        if not self._lockstep or self._ahead() <= 0.0:
            self._publish_state()
        else:
            self._started = False
            self.wake_now()
        self._send_applied(stamp, applied)
        self.report(self._stamp)
        self._show_progress()
        if self._lockstep and self._step % _ACKNOWLEDGED_EVERY == 0:
            self._let_subscribers_follow()

    def _let_subscribers_follow(self) -> None:
        """Wait for a recorder that lags, before the publishers' memory overflows."""
        if not self.flush(_LAG_PATIENCE):
            self.complain("lag", "a subscriber does not keep up: it may lose messages")

    def _step_if_complete(self) -> None:
        if all(self._input_stamps[name] == self._stamp for name in self._wait_for):
            self._advance(self._inputs[TORQUE_COMMAND.name], self._inputs[DISTURBANCE.name])

    def _ahead(self) -> float:
        """Seconds by which simulated time is ahead of the pace that is asked for."""
        factor = self.parameters["real_time_factor"] if self._lockstep else 1.0
        if factor == 0.0:
            return 0.0
        return seconds(self._stamp) / factor - (time.monotonic() - self._origin)

    def wake(self) -> float:
        """Step when it is time (free-running), or repeat a state that is unanswered (lock-step)."""
        self.report_if_idle()
        self._look_for_rival()
        return self._wake_lockstep() if self._lockstep else self._wake_free()

    def _wake_free(self) -> float:
        if not self._started:
            self._publish_state()
            self._origin = self._last_sent = time.monotonic()
        if self._awaits_first_answer():
            return self._repeat_unanswered()
        # The present state was published at origin + stamp; the next one is due a period later.
        due = self._origin + seconds(stamp_of(self._step + 1, self._rate))
        late = time.monotonic() - due
        if late < 0.0:
            return min(-late, 0.1)
        if late > _REBASE:
            self.complain("pause", f"paused for {late:.2f} s: simulated time goes on from now")
            self._origin += late
            self._overruns += 1
        elif late > 1.0 / self._rate:
            self._overruns += 1
            self.complain("overrun", f"step {self._step} is {1e3 * late:.1f} ms late")
        if self._input_stamps[TORQUE_COMMAND.name] < self._stamp:
            self._late_commands += 1
        self._advance(self._held, self._input_or_zero(DISTURBANCE.name))
        # The command for this new state is still to come: what arrived last acts, a sample late.
        self._held = self._input_or_zero(TORQUE_COMMAND.name)
        return 0.0

    def _awaits_first_answer(self) -> bool:
        if self._step or not self.parameters[WAIT_FOR_RECORDER.name]:
            return False
        return any(self._input_stamps[name] < 0 for name in self._wait_for)

    def _look_for_rival(self) -> None:
        rival = self._rival.look()
        if rival and self._rival.came_second:
            self.fail(self._stamp, f"{rival}; this plant is the newer one and ends")
        elif rival:
            self.complain("rival", rival)

    def _input_or_zero(self, name: str) -> Vector:
        """Return the latest torque of an input, or zero when it is older than the time-out."""
        stamp = self._input_stamps[name]
        expected = stamp >= 0 or name == TORQUE_COMMAND.name  # an injector need not be there
        timed_out = expected and self._stamp - max(stamp, 0) > self._timeout_ns
        if timed_out != (name in self._timed_out):
            self._timed_out ^= {name}
            when = f"t = {seconds(self._stamp):.3f} s"
            if timed_out:
                timeout = self.parameters["command_timeout"]
                self.get_logger().warning(f"no {name} for {timeout} s: zero torque from {when}")
            else:
                self.get_logger().info(f"{name} is back at {when}")
            self.report(self._stamp, at_once=True)
        return _ZERO if timed_out else self._inputs[name]

    def _wake_lockstep(self) -> float:
        ahead = self._ahead()
        if ahead > 0.0:
            return min(ahead, 0.1)
        if not self._started:
            self._publish_state()
            self._last_sent = time.monotonic()
        return self._repeat_unanswered()

    def _repeat_unanswered(self) -> float:
        now = time.monotonic()
        if now - self._last_sent >= self._repeat_after:
            self._publish_state()
            self._last_sent = now
            self._repeat_after = min(2.0 * self._repeat_after, _REPEAT_MOST)
        self.say_waiting(self._waiting_since, self._waiting_text)
        return 0.1

    def _waiting_text(self) -> str:
        missing = [name for name in self._wait_for if self._input_stamps[name] != self._stamp]
        absent = [name for name in missing if not self.count_publishers(name)]
        text = f"waiting at t = {seconds(self._stamp):.3f} s for {', '.join(missing)}"
        return f"{text}; nobody publishes {', '.join(absent)}" if absent else text

    def _on_reset(self, request: Any, response: Any) -> Any:
        self._begin()
        self.wake_now()
        self.get_logger().info("reset: time begins again at zero")
        response.success = True
        response.message = "time begins again at zero"
        return response

    def _show_progress(self) -> None:
        if self._progress and time.monotonic() - self._shown > self._progress:
            self._shown = time.monotonic()
            print(f"t {seconds(self._stamp):.3f}", flush=True)

    def status(self) -> tuple[bytes, str, dict[str, Any]]:
        """Waiting, zero torque for lack of commands, or running."""
        details = {
            "steps": self._step,
            "rate [Hz]": self._rate,
            "mode": "lock-step" if self._lockstep else "free-running",
            "overruns": self._overruns,
            "late commands": self._late_commands,
        }
        if self._rival.found:
            return ERROR, self._rival.found, details
        if self._lockstep and time.monotonic() - self._waiting_since > 1.0:
            return STALE, self._waiting_text(), details
        if self._timed_out:
            return WARN, f"no {', '.join(sorted(self._timed_out))}: zero torque", details
        return OK, "running", details


def main() -> int:
    """Run the executable `spacecraft_plant`; ``--progress`` prints simulated time on stdout."""
    progress = "--progress" in sys.argv
    arguments = [argument for argument in sys.argv if argument != "--progress"]
    return run_node(lambda: SpacecraftPlant(progress), arguments)


if __name__ == "__main__":
    sys.exit(main())
