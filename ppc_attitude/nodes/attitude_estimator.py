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

"""The estimator: estimates attitude, rate and gyro bias from gyro and star tracker.

A run has it only with `sensors: true`.
"""

import sys
from collections.abc import Sequence
from functools import partial
from typing import Any

from ppc_attitude.contract.declared import components_of
from ppc_attitude.contract.topics import ESTIMATOR, Topic
from ppc_attitude.nodes.component_node import ComponentNode
from ppc_attitude.nodes.running import run_node
from ppc_attitude.runtime.fixes import Fixes
from ppc_attitude.runtime.stamps import Instant
from ppc_attitude.science.sensors.star_tracker import Slots, check_slots


class AttitudeEstimator(ComponentNode):
    """Runs the selected filter at an instant, once its samples and the due fix have come."""

    executable = ESTIMATOR
    tells_advice = True

    def new_instant(self, topics: Sequence[Topic]) -> Instant:
        """Return what collects the samples of an instant, and joins the fixes to them."""
        self._fixes: Fixes | None = None
        for component in components_of(self.executable, self.parameters.values):
            check_slots(component)
        late = [each for each in topics if each.late]
        if not late:
            return super().new_instant(topics)
        sample = (each.column for each in topics if not each.late)
        self._fixes = Fixes(Slots(self.parameters.values), late[0], sample)
        return self._fixes

    def wake(self) -> float:
        """Say which fix is waited for, if it does not come."""
        if self._fixes:
            self.say_waiting(self._fixes.waiting_since, self._fixes.waiting)
        return super().wake()

    def details(self) -> dict[str, Any]:
        """Numbers for `/diagnostics`."""
        details = super().details()
        if self._fixes:
            details["fixes not there in time"] = self._fixes.lost
            details["fixes after a newer one"] = self._fixes.useless
        return details


main = partial(run_node, AttitudeEstimator)

if __name__ == "__main__":
    sys.exit(main())
