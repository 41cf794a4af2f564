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
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any

from ppc_attitude.contract.declared import components_of
from ppc_attitude.contract.topics import ESTIMATOR, Topic
from ppc_attitude.nodes.component_node import ComponentNode
from ppc_attitude.nodes.running import run_node
from ppc_attitude.runtime.fixes import Fixes
from ppc_attitude.runtime.health import STALE, Status
from ppc_attitude.runtime.stamps import Instant, Values
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.sensors.arrivals import Slots, check_slots


class AttitudeEstimator(ComponentNode):
    """Runs the selected filter; an instant is complete when the fix is there that is due."""

    executable = ESTIMATOR

    def new_instant(self, topics: Sequence[Topic]) -> Instant:
        """Return what collects the samples of an instant; `Fixes` join the fixes to them."""
        self._fixes: Fixes | None = None
        late = [each for each in topics if each.late]
        if not late:
            return super().new_instant(topics)
        if not len(late) == 1 < len(topics):
            names = ", ".join(each.name for each in topics)
            raise ConfigurationError(
                f"the estimator reads {names}; allowed: one that comes late, such as fixes, "
                "beside what comes with every instant"
            )
        for component in components_of(self.executable, self.parameters.values):
            check_slots(component)
        (self._late,) = late
        self._fixes = Fixes(Slots(self.parameters.values), self._late.width)
        return super().new_instant([each for each in topics if not each.late])

    def receive(self, topic: Topic, stamp_ns: int, values: Values) -> None:
        """Take a message; a fix may complete several instants."""
        if self._fixes is not None and topic.late:
            self._answer_all(self._fixes.fix(stamp_ns, values))
        else:
            super().receive(topic, stamp_ns, values)

    def on_instant(self, stamp_ns: int, parts: Mapping[str, Values]) -> None:
        """Answer an instant whose samples are all there, and those that waited for no more."""
        if self._fixes is None:
            super().on_instant(stamp_ns, parts)
        else:
            self._answer_all(self._fixes.sample(stamp_ns, parts, self.now()))

    def _answer_all(self, completed: Iterable[tuple[int, Mapping[str, Values], Values]]) -> None:
        for stamp, parts, row in completed:
            super().on_instant(stamp, {**parts, self._late.column: row})

    def details(self) -> dict[str, Any]:
        """Numbers for `/diagnostics`."""
        lost, useless = (self._fixes.lost, self._fixes.useless) if self._fixes else (0, 0)
        counts = {"fixes not there in time": lost, "fixes after a newer one": useless}
        return {**super().details(), **counts}

    def status(self) -> Status:
        """Status of the filter, or that of every component node."""
        status = super().status()
        if status.level == STALE and self._fixes and self._fixes.waits_for_fix:
            return Status(STALE, f"waiting for {self._late.name}", status.details)
        return self.advised(status)


main = partial(run_node, AttitudeEstimator)

if __name__ == "__main__":
    sys.exit(main())
