"""The plant: integrates the rigid body, publishes its state, and owns simulated time."""

import sys
import time
from collections.abc import Mapping
from typing import Any

from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from ppc_attitude.contract.cdr import encode_clock, seconds, stamp_of
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    APPLIED_TORQUE,
    ATTITUDE,
    CLOCK_TOPIC,
    DISTURBANCE,
    PLANT,
    TORQUE_COMMAND,
)
from ppc_attitude.nodes.base import OK, STALE, WARN, BaseNode, run_node
from ppc_attitude.nodes.messages import RefusedError
from ppc_attitude.nodes.qos import published
from ppc_attitude.science.kernel import Vector
from ppc_attitude.science.parameter import Value
from ppc_attitude.science.spacecraft import applied_torque, measured, plant_step
from ppc_attitude.simulation.scenario import initial_state, nanoseconds, plant_record

_ZERO: Vector = (0.0, 0.0, 0.0)
_REPEAT_FIRST, _REPEAT_MOST = 0.2, 1.0  # [s] unanswered states are repeated after this
_SAY_WAITING = 5.0  # [s] between two messages about what the plant waits for
_REBASE = 0.5  # [s] a plant that is later than this goes on from now instead of catching up
_PROGRESS_PERIOD = 0.1  # [s]


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
        self._begin()

    def check(self, values: Mapping[str, Value]) -> None:
        """See that inertia, torque limits and initial attitude are possible."""
        plant_record(values)

    def _apply_parameters(self) -> None:
        self._plant = plant_record(self.parameters.values)
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
        self._overruns = 0
        self._timed_out = False
        self._started = False
        self._waiting_since = self._last_sent = self._last_said = time.monotonic()
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
                    raise RefusedError(f"{name}: stamp {seconds(stamp_ns):.6f} s is out of order")
                return  # a peer's repeated answer
            if self._lockstep and stamp_ns < self._stamp:
                return  # an answer to an earlier state, sent before its peer saw this one
            self._inputs[name] = (values[0], values[1], values[2])
            self._input_stamps[name] = stamp_ns
            if self._lockstep:
                self._step_if_complete()

        return receive

    def _publish_state(self) -> None:
        self._clock_publisher.publish(encode_clock(self._stamp))
        q, omega = measured(self._plant, self._q, self._omega, self._step)
        self._send_attitude(self._stamp, q)
        self._send_rate(self._stamp, omega)
        self._started = True

    def _advance(self, command: Vector, disturbance: Vector) -> None:
        """Hold both torques until the next stamp, publish what acted and the new state."""
        applied = applied_torque(self._plant, command)
        stamp = self._stamp
        if self._step == self._last_step:
            self._send_applied(stamp, applied)
            self.finished = True
            return
        self._step += 1
        self._stamp = stamp_of(self._step, self._rate)
        h = (self._stamp - stamp) * 1e-9
        self._q, self._omega = plant_step(
            self._plant, self._q, self._omega, applied, disturbance, h
        )
        if self.parameters.changed:
            self._apply_parameters()
        self._waiting_since = self._last_sent = time.monotonic()
        self._repeat_after = _REPEAT_FIRST
        if not self._lockstep or self._ahead() <= 0.0:
            self._publish_state()
        else:
            self._started = False
        self._send_applied(stamp, applied)
        self.report(self._stamp)
        self._show_progress()

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
        self.report_if_idle(self._stamp)
        return self._wake_lockstep() if self._lockstep else self._wake_free()

    def _wake_free(self) -> float:
        ahead = self._ahead()
        if ahead > 0.0:
            return min(ahead, 0.1)
        if not self._started:
            self._publish_state()
            self._origin = time.monotonic()
        elif ahead < -_REBASE:
            self.complain("pause", f"paused for {-ahead:.2f} s: simulated time goes on from now")
            self._origin -= ahead
            self._overruns += 1
        elif ahead < -1.0 / self._rate:
            self._overruns += 1
            self.complain("overrun", f"step {self._step} is {-1e3 * ahead:.1f} ms late")
        self._advance(self._command_or_zero(), self._inputs[DISTURBANCE.name])
        return 0.0

    def _command_or_zero(self) -> Vector:
        """Return the held torque, or zero when the last command is older than the time-out."""
        age_ns = self._stamp - self._input_stamps[TORQUE_COMMAND.name]
        timed_out = self._input_stamps[TORQUE_COMMAND.name] < 0 or age_ns > self._timeout_ns
        if timed_out != self._timed_out:
            self._timed_out = timed_out
            if timed_out:
                self.get_logger().warning(
                    f"no torque_command for {self.parameters['command_timeout']} s: zero torque "
                    f"from t = {seconds(self._stamp):.3f} s"
                )
            else:
                self.get_logger().info(f"commands are back at t = {seconds(self._stamp):.3f} s")
            self.report(self._stamp, at_once=True)
        return _ZERO if timed_out else self._inputs[TORQUE_COMMAND.name]

    def _wake_lockstep(self) -> float:
        ahead = self._ahead()
        if ahead > 0.0:
            return min(ahead, 0.1)
        now = time.monotonic()
        if not self._started:
            self._publish_state()
            self._last_sent = now
        elif now - self._last_sent >= self._repeat_after:
            self._publish_state()
            self._last_sent = now
            self._repeat_after = min(2.0 * self._repeat_after, _REPEAT_MOST)
        if now - max(self._waiting_since, self._last_said) >= _SAY_WAITING:
            self._last_said = now
            self.get_logger().warning(self._waiting_text())
        return 0.1

    def _waiting_text(self) -> str:
        missing = [name for name in self._wait_for if self._input_stamps[name] != self._stamp]
        absent = [name for name in missing if not self.count_publishers(name)]
        text = f"waiting at t = {seconds(self._stamp):.3f} s for {', '.join(missing)}"
        return f"{text}; nobody publishes {', '.join(absent)}" if absent else text

    def _on_reset(self, request: Any, response: Any) -> Any:
        self._begin()
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
            "time [s]": seconds(self._stamp),
            "steps": self._step,
            "rate [Hz]": self._rate,
            "mode": "lock-step" if self._lockstep else "free-running",
            "overruns": self._overruns,
        }
        if self._lockstep and time.monotonic() - self._waiting_since > 1.0:
            return STALE, self._waiting_text(), details
        if self._timed_out:
            return WARN, "no torque_command: zero torque", details
        return OK, "running", details


def main() -> int:
    """Run the executable `spacecraft_plant`; ``--progress`` prints simulated time on stdout."""
    progress = "--progress" in sys.argv
    arguments = [argument for argument in sys.argv if argument != "--progress"]
    return run_node(lambda: SpacecraftPlant(progress), arguments)


if __name__ == "__main__":
    sys.exit(main())
