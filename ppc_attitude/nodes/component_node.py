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

"""A node that runs components: it collects their inputs by stamp, steps, publishes the outputs."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from ppc_attitude.contract.declared import BY_COLUMN, columns_of, components_of
from ppc_attitude.contract.topics import ATTITUDE, TRUE_ATTITUDE, Topic
from ppc_attitude.nodes.base import BaseNode
from ppc_attitude.runtime.chain import Chain
from ppc_attitude.runtime.health import ERROR, OK, STALE, WARN, Status
from ppc_attitude.runtime.stamps import Answers, Instant, States, Values
from ppc_attitude.science.component import read_from_elsewhere
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.parameter import Value
from ppc_attitude.science.stamps import seconds
from ppc_attitude.simulation.scenario import check_components


class ComponentNode(BaseNode):
    """Answers each state with the outputs of its components at that instant.

    Components that read nothing depend on time alone, so their answers are sent an instant ahead.
    They need but the stamps of the states (`States`).
    """

    tells_advice = False  # its status is the advice of its components, if they have any
    _exchanges: tuple[set[str], set[str]] | None = None  # columns read and given, once it runs

    def __init__(self) -> None:
        super().__init__()
        values = self.parameters.values
        self._exchanges = self._exchanged(values)
        self.chain = Chain(components_of(self.executable, values), values)
        self._topics = [BY_COLUMN[column.name] for column in self.chain.inputs] or [ATTITUDE]
        self._instant = self.new_instant(self._topics)
        columns = columns_of(self.executable, values)
        # A late column belongs to an earlier instant: if it were sent ahead, its last message would
        # arrive after the end of the run.
        ahead = not self.chain.inputs and not any(column.late for column in columns)
        self.answers = Answers(self._answer, ahead, self._begin_again)
        self._senders = {each.name: self.sender(BY_COLUMN[each.name]) for each in columns}
        self._steps = 0
        if self.chain.inputs:
            for topic in self._topics:
                self.listen(topic, partial(self._receive, topic))
        else:
            states = States()
            for topic in (ATTITUDE, TRUE_ATTITUDE):
                self.listen(topic, partial(self._on_state, states, topic == TRUE_ATTITUDE))

    def new_instant(self, topics: Sequence[Topic]) -> Instant:
        """Return what collects the messages of an instant on the topics that are read."""
        return Instant(topic.column for topic in topics)

    def check(self, values: Mapping[str, Value]) -> None:
        """See that the selected components can run with the parameters, and on the same topics."""
        check_components(self.executable, values)
        if self._exchanges not in (None, self._exchanged(values)):
            names = ", ".join(each.name for each in components_of(self.executable, values))
            told = f"{self.executable}: {names} would read or publish other topics"
            raise ConfigurationError(f"{told} than now; restart the node with this selection")

    def _exchanged(self, values: Mapping[str, Value]) -> tuple[set[str], set[str]]:
        read = read_from_elsewhere(components_of(self.executable, values))
        given = columns_of(self.executable, values)
        return {column.name for column in read}, {column.name for column in given}

    def apply_parameters(self, stamp_ns: int) -> None:
        """Take over parameters that have changed, from a stamp [ns] on."""
        self.take_changes(stamp_ns)
        values = self.parameters.values
        self.chain.configure(components_of(self.executable, values), values)
        if not self.chain.inputs:
            self.chain.forget()  # what depends on time alone has no past

    def wake(self) -> float:
        """Say what is missing, if messages come whose stamps do not pair."""
        instant = self._instant
        self.say_waiting(
            instant.waiting_since, lambda: self._missing() if instant.is_stuck(self.now()) else ""
        )
        return super().wake()

    def _missing(self) -> str:
        missing = [BY_COLUMN[column].name for column in self._instant.missing()]
        together = " with the same new stamp" if len(missing) > 1 else ""
        return f"waiting for {', '.join(missing)}{together}"

    def arm(self) -> None:
        """Forget the past: the next step begins anew."""
        self.chain.forget()

    def forget_orders(self) -> str:
        """Forget what was ordered in flight: time has begun again. Return what that was, if any."""
        return ""

    def compute(self, stamp_ns: int, inputs: Mapping[str, Values]) -> dict[str, Values]:
        """Run the components at an instant; return the numbers of all columns by name."""
        return self.chain.step(stamp_ns, inputs)

    def _receive(self, topic: Topic, stamp_ns: int, values: Values) -> None:
        """Take a message of a topic that is read; step once its instant is complete."""
        for stamp, parts in self._instant.take(topic.column, stamp_ns, values, self.now()):
            self.on_instant(stamp, parts)

    def _on_state(self, states: States, true: bool, stamp_ns: int, _: Values) -> None:
        if states.tells(stamp_ns, true, self.now()):
            self._receive(ATTITUDE, stamp_ns, ())

    def on_instant(self, stamp_ns: int, parts: Mapping[str, Values]) -> None:
        """Answer a complete instant [ns]; the parts are its messages by column."""
        read = self._topics[0]
        for stamp, answer in self.answers.to(read, stamp_ns, parts, self.now()).items():
            if why := self.chain.not_finite(answer, self._senders):
                self.fail(stamp, f"at t = {seconds(stamp):.3f} s {why}")
                return
            for column, send in self._senders.items():
                send(stamp, answer[column])
        self.say_all(self.chain.news())
        self.report(stamp_ns)

    def _answer(self, stamp_ns: int, inputs: Mapping[str, Values]) -> dict[str, Values]:
        if self.parameters.changed:
            self.apply_parameters(stamp_ns)
        self._steps += 1
        return self.compute(stamp_ns, inputs)

    def _begin_again(self, stamp_ns: int) -> None:
        goes_on = stamp_ns > self.health.time_ns
        told = "goes on after a gap" if goes_on else "has begun again"
        text = f"time {told} at {seconds(stamp_ns):.3f} s: re-armed"
        if not goes_on and (forgotten := self.forget_orders()):
            self.complain("restart", f"{text}; {forgotten} are forgotten")
        else:
            self.mention("restart", text)
        if not goes_on:
            self.tell_again(stamp_ns)
        self.arm()
        self.health.begin_again()

    def details(self) -> dict[str, Any]:
        """Numbers for `/diagnostics`."""
        return {"steps": self._steps, "instants incomplete": self._instant.dropped}

    def status(self) -> Status:
        """Waiting for inputs, outside an envelope, advised, or running."""
        told = [part.normalised_errors() for part in self.chain.parts]
        normalised = {name: value for each in told for name, value in each.items()}
        margins = {f"{name} margin": 1.0 - value for name, value in normalised.items()}
        details = {**self.details(), **margins, **self.chain.numbers}
        if self.is_idle():
            return Status(STALE, self._missing(), details)
        level, summary = OK, "running"
        if outside := [name for name, value in normalised.items() if value > 1.0]:
            level, summary = WARN, f"error outside {', '.join(outside)}"
        for part in self.chain.parts if self.tells_advice else ():
            if part.advice.text:
                summary, warning, failed, _ = part.advice
                level = ERROR if failed else WARN if warning else level
        return Status(level, summary, details)
