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

"""The plant: integrates craft and actuators, publishes the state, and owns simulated time."""

import sys
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from std_srvs.srv import Trigger

from ppc_attitude.contract.cdr import LARGEST, encode_clock, header_stamp
from ppc_attitude.contract.declared import BY_COLUMN, columns_of, components_of, gives
from ppc_attitude.contract.parameters import SEND_TRUTH, WAIT_FOR_RECORDER
from ppc_attitude.contract.topics import (
    CLOCK_TOPIC,
    DISTURBANCE,
    PLANT,
    RECORDED_TOPIC,
    TORQUE_COMMAND,
    TRUE_RATE,
    Topic,
)
from ppc_attitude.nodes.base import BaseNode
from ppc_attitude.nodes.messages import publisher_of, subscribe
from ppc_attitude.nodes.running import run_node
from ppc_attitude.processes.telling import FINISHED, TIME, tell
from ppc_attitude.runtime.chain import Chain
from ppc_attitude.runtime.health import ERROR, OK, WARN, Status
from ppc_attitude.runtime.pace import FreeRunning, Lockstep, Rules
from ppc_attitude.runtime.stamps import Values
from ppc_attitude.science.component import Column, Component, read_from_elsewhere
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.faults import FAULTS, acting_of, fault_texts
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.kinds import CONTROLLERS, KINDS
from ppc_attitude.science.parameter import Value
from ppc_attitude.science.part import first_raised
from ppc_attitude.science.stamps import nanoseconds, seconds, stamp_of
from ppc_attitude.simulation.scenario import check_components

_PROGRESS_PERIOD = 0.1  # [s]
_AFTER_THE_LAW = KINDS[KINDS.index(CONTROLLERS) + 1 :]


class SpacecraftPlant(BaseNode):
    """The craft's body, sensors and actuators; free-running, or in lock-step with its inputs."""

    executable = PLANT
    _sent: frozenset[Column] | None = None  # columns that it sends, once it runs

    def __init__(self) -> None:
        super().__init__()
        values: Mapping[str, Any] = self.parameters.values
        self._told_at = 0.0
        motion, acting = _split(values)
        self._motion, self._acting = Chain(motion, values), Chain(acting, values)
        topics = [BY_COLUMN[each.name] for each in read_from_elsewhere((*acting, *motion))]
        self._columns = {topic.name: topic.column for topic in topics}

        clock = publisher_of(self, CLOCK_TOPIC)
        self._publish_clock = clock.handle.publish_raw
        self._watch.add_shared(clock.topic_name)
        self._select_columns()
        rate, duration = float(values["rate"]), values["duration"]
        rules = Rules(
            rate=rate,
            last_step=round(duration * rate) if duration else None,
            inputs={topic.name: (0.0,) * topic.width for topic in topics},
            wait_for=tuple(topic.name for topic in topics if _awaited(topic) in values["wait_for"]),
            waits=bool(values[WAIT_FOR_RECORDER.name]),
        )
        kind = Lockstep if values["lockstep"] else FreeRunning
        self.pace = kind(self, rules, self.now())
        for topic in topics:
            self.listen(topic, partial(self._on_input, topic.name))
        self.create_service(Trigger, "~/reset", self._on_reset)
        subscribe(self, RECORDED_TOPIC, self._on_recorded, raw=True)

    def check(self, values: Mapping[str, Value]) -> None:
        """See that time can go on, that the components can run, and that the truth is sent."""
        _check_pace(values)
        check_components(PLANT, values)
        if self._sent is not None and not self._sent.issuperset(columns_of(PLANT, values)):
            raise ConfigurationError(
                "sensing would no longer be exact, and this plant does not publish the truth by "
                f"which a run is judged; restart it with {SEND_TRUTH.name} = true"
            )

    def _apply_parameters(self) -> None:
        self.take_changes(self.pace.stamp)
        values: Mapping[str, Any] = self.parameters.values
        motion, acting = _split(values)
        self._motion.configure(motion, values)
        self._acting.configure(acting, values)

    def _select_columns(self) -> None:
        """Publish what goes on record; the truth too, if sensing differs from it."""
        recorded = columns_of(PLANT, self.parameters.values)
        self._sent = frozenset(recorded)
        first = [column for column in gives(PLANT) if column in recorded]  # others wait for these
        acted = [column for part in self._acting.parts for column in part.component.outputs]
        columns = dict.fromkeys((*first, *recorded))
        self._state_columns = [column.name for column in columns if column not in acted]
        self._acted_columns = [column.name for column in columns if column in acted]
        self._senders = {column.name: self.sender(BY_COLUMN[column.name]) for column in columns}

    # What `runtime.pace` moves.

    def begin(self) -> None:
        """Take the initial state at time zero."""
        self._motion.forget()
        self._acting.forget()
        zeros = {column.name: (0.0,) * column.width for column in self._motion.inputs}
        self._state = self._motion.step(0, zeros)
        self.say_all(self._motion.news())
        self.health.begin_again()

    def act(self, stamp_ns: int, inputs: Mapping[str, Values]) -> None:
        """Hold the inputs from a stamp [ns] on."""
        known = {self._columns[name]: values for name, values in inputs.items()}
        self._acted = self._acting.step(stamp_ns, {**self._state, **known})
        self._acted_at = stamp_ns

    def move_to(self, stamp_ns: int) -> None:
        """Reach the next stamp [ns]."""
        self._state = self._motion.step(stamp_ns, self._acted)
        rate = self._state[TRUE_RATE.column]
        if not sum(map(abs, rate)) <= LARGEST:  # true for NaN, too
            why = first_raised((*self._acting.parts, *self._motion.parts))
            raise _FailedError(
                f"diverged: angular velocity {rate} rad/s at {seconds(stamp_ns)} s{why}"
            )
        if self.parameters.changed:
            self._apply_parameters()

    def show(self) -> None:
        """Publish the present state: the attitude last, because all peers start at it."""
        if why := self._motion.not_finite(self._state, self._state_columns):
            raise _FailedError(f"at t = {seconds(self.pace.stamp):.3f} s {why}")
        self._publish_clock(encode_clock(self.pace.stamp))
        for name in reversed(self._state_columns):
            self._senders[name](self.pace.stamp, self._state[name])

    def tell_acted(self) -> None:
        """Publish the torque that acted last."""
        for name in self._acted_columns:
            self._senders[name](self._acted_at, self._acted[name])
        self.say_all(self._acting.news())
        self.report(self.pace.stamp)
        self._tell_time()

    def _tell_time(self) -> None:
        """Tell the starter the simulated time now and then, which shows that the run goes on."""
        if self.now() - self._told_at > _PROGRESS_PERIOD:
            self._told_at = self.now()
            tell(TIME, seconds(self.pace.stamp))

    def is_published(self, name: str) -> bool:
        """True if anybody publishes on a topic."""
        return self.count_publishers(self.resolve_topic_name(name)) > 0

    def announce(self, text: str, warning: bool) -> None:
        """Log that something has changed, and report it."""
        self.say_all([Advice(text, warning)])
        self.report(self.pace.stamp, at_once=True)

    # What comes from outside.

    def _on_input(self, name: str, stamp_ns: int, values: Values) -> None:
        if not self.finished and self._moved(self.pace.take, name, stamp_ns, values):
            self.wake_now()

    def _on_recorded(self, data: bytes) -> None:
        stamp_ns = header_stamp(data, RECORDED_TOPIC.msgtype)
        if stamp_ns is None:
            self.refuse(RECORDED_TOPIC.name, f"{RECORDED_TOPIC.name}: {len(data)} bytes, no stamp")
        else:
            self._moved(self.pace.record, stamp_ns)
            self.wake_now()

    def _moved(self, move: Callable[..., Any], *values: Any) -> Any:
        """Call a method of the pace with the present time; end the node if the run is over."""
        try:
            result = move(*values, self.now())
        except _FailedError as reason:
            self.fail(self.pace.stamp, str(reason))
            return None
        if self.pace.finished:
            tell(FINISHED, True)
            self.finish()
        return result

    def wake(self) -> float:
        """Step when it is time (free-running), or repeat a state that is unanswered (lock-step)."""
        longest = super().wake()
        if self.finished:
            return longest
        # These two act at once and not with the next step, for which a slow pace may wait long.
        self.pace.rules.factor = self.parameters["real_time_factor"]
        self.pace.rules.timeout_ns = nanoseconds(self.parameters["command_timeout"])
        wait = self._moved(self.pace.wake)
        self.say_waiting(self.pace.waiting_since, self.pace.waiting)
        if self._told_at:  # time has begun
            self._tell_time()
        return longest if wait is None else float(wait)

    def _on_reset(self, request: Any, response: Any) -> Any:
        self.pace.begin(self.now())
        self.tell_again(0)
        self.wake_now()
        told = "time begins again at zero"
        self.get_logger().info(f"reset: {told}")
        return Trigger.Response(success=True, message=told)

    def status(self) -> Status:
        """Waiting, zero torque for lack of commands, faulty, or running."""
        level, summary, details = self.pace.report(self.now())
        numbers = {**self._motion.numbers, **self._acting.numbers}
        faults = "; ".join(acting_of(fault_texts(self.parameters.values), self.pace.stamp))
        if level == OK and faults:
            level, summary = WARN, f"{summary} with {faults}"
        for part in self._acting.parts:
            if part.advice.failed:
                level, summary = ERROR, part.advice.text
        return Status(level, summary, {**details, **numbers, FAULTS.name: faults or "none"})


class _FailedError(Exception):
    """The state is no longer one that a craft can have; the message says why."""


def _awaited(topic: Topic) -> str:
    """Name of an input in `wait_for`: every input but the disturbance counts as the command."""
    return DISTURBANCE.name if topic == DISTURBANCE else TORQUE_COMMAND.name


def _check_pace(values: Mapping[str, Any]) -> None:
    """See that lock-step waits, so that requests are served, and no command is late at once."""
    if values["lockstep"]:
        if not values["wait_for"]:
            both = f"{TORQUE_COMMAND.name}, {DISTURBANCE.name} or both"
            raise ConfigurationError(f"{PLANT}: wait_for = []; allowed in lock-step: {both}")
    elif nanoseconds(values["command_timeout"]) < stamp_of(1, values["rate"]):
        raise ConfigurationError(
            f"{PLANT}: command_timeout = {values['command_timeout']} s; allowed on the wall clock: "
            f"≥ {seconds(stamp_of(1, values['rate'])):.9g} s, one step, because a command acts in "
            "the step after it"
        )


def _split(values: Mapping[str, Any]) -> tuple[list[Component], list[Component]]:
    """Components that give the state of an instant, and those that act from it on."""
    components = components_of(PLANT, values)
    acting = [kind.selected(values) for kind in _AFTER_THE_LAW]
    return [each for each in components if each not in acting], [
        each for each in components if each in acting
    ]


main = partial(run_node, SpacecraftPlant)

if __name__ == "__main__":
    sys.exit(main())
