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

"""The estimator: attitude, rate and gyro bias from what the sensors measure."""

import sys
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from ppc_attitude.contract.declared import components_of
from ppc_attitude.contract.topics import ESTIMATOR, Topic
from ppc_attitude.nodes.component_node import ComponentNode
from ppc_attitude.nodes.running import run_node
from ppc_attitude.runtime.fixes import Fixes
from ppc_attitude.runtime.health import ERROR, STALE, WARN, Status
from ppc_attitude.runtime.stamps import Instant, Values
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.sensors.arrivals import Slots, check_slots

Completed = Iterator[tuple[int, Mapping[str, Values], Values]]


class AttitudeEstimator(ComponentNode):
    """Runs the selected filter; an instant is complete when the fix is there that is due."""

    executable = ESTIMATOR

    def __init__(self) -> None:
        self._fixes: Fixes | None = None
        super().__init__()

    def _receiver(self, topic: Topic) -> Callable[[int, Values], None]:
        late = [each for each in self._topics if each.late]
        if not late:
            return super()._receiver(topic)
        if self._fixes is None:
            if not len(late) == 1 < len(self._topics):
                names = ", ".join(each.name for each in self._topics)
                raise ConfigurationError(
                    f"the estimator reads {names}; allowed: one that comes late, such as fixes, "
                    "beside what comes with every instant"
                )
            for component in components_of(self.executable, self.parameters.values):
                check_slots(component)
            self._fixes = Fixes(Slots.of(self.parameters.values), late[0].width)
            self._instant = Instant(each.column for each in self._topics if not each.late)
        fixes, column, fix = self._fixes, topic.column, late[0].column

        def answer(completed: Completed) -> None:
            for stamp, parts, row in completed:
                self._on_instant(stamp, {**parts, fix: row})

        def receive_fix(stamp_ns: int, values: Values) -> None:
            answer(fixes.fix(stamp_ns, values, self.now()))

        def receive_sample(stamp_ns: int, values: Values) -> None:
            parts = self._instant.add(column, stamp_ns, values)
            if parts is not None:
                answer(fixes.sample(stamp_ns, parts, self.now()))

        return receive_fix if topic.late else receive_sample

    def details(self) -> dict[str, Any]:
        """Numbers for `/diagnostics`."""
        lost, useless = (self._fixes.lost, self._fixes.useless) if self._fixes else (0, 0)
        counts = {"fixes that never came": lost, "fixes too late or of no slot": useless}
        return {**super().details(), **counts}

    def status(self) -> Status:
        """Status of the filter, or that of every component node."""
        status = super().status()
        if status.level == STALE and self._fixes and self._fixes.waits_for_fix:
            late = ", ".join(topic.name for topic in self._topics if topic.late)
            return Status(STALE, f"waiting for {late}", status.details)
        for part in self.chain.parts:
            if status.level != STALE and part.advice.text:
                text, warning, failed, _ = part.advice
                level = ERROR if failed else WARN if warning else status.level
                status = Status(level, text, status.details)
        return status


def main() -> int:
    """Run the executable `attitude_estimator`."""
    return run_node(AttitudeEstimator)


if __name__ == "__main__":
    sys.exit(main())
