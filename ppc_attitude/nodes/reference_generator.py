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

"""The reference generator: the desired motion of every instant."""

import sys
from collections.abc import Mapping

from ppc_attitude.contract.topics import REFERENCE
from ppc_attitude.nodes.component_node import ComponentNode
from ppc_attitude.nodes.guidance_desk import GuidanceDesk
from ppc_attitude.nodes.running import run_node
from ppc_attitude.runtime.health import OK, WARN, Status
from ppc_attitude.runtime.stamps import Values
from ppc_attitude.science.references import goal


class ReferenceGenerator(ComponentNode):
    """Desired attitude, rate and acceleration; in mode `goal` it takes goals in flight."""

    executable = REFERENCE

    def __init__(self) -> None:
        super().__init__()
        (part,) = self.chain.parts
        self._desk = GuidanceDesk(self, part) if part.component is goal.COMPONENT else None

    def apply_parameters(self, stamp_ns: int) -> None:
        """Take over parameters; the goals that were given in flight stay."""
        super().apply_parameters(stamp_ns)
        if self._desk:
            self._desk.configure()

    def arm(self) -> None:
        """Forget the past, and the goals that were given in flight."""
        super().arm()
        if self._desk:
            self._desk.begin_again()

    def compute(self, stamp_ns: int, inputs: Mapping[str, Values]) -> dict[str, Values]:
        """Desired motion of an instant, with the goals that have come."""
        if self._desk:
            self._desk.before(stamp_ns)
        outputs = super().compute(stamp_ns, inputs)
        if self._desk:
            self._desk.after(stamp_ns)
        return outputs

    def status(self) -> Status:
        """As of any such node; a warning while the guidance warns of something."""
        status = super().status()
        concern = self._desk.concern if self._desk else ""
        if status.level == OK and concern:
            return Status(WARN, f"the desired motion {concern}", status.details)
        return status


def main() -> int:
    """Run the executable `reference_generator`."""
    return run_node(ReferenceGenerator)


if __name__ == "__main__":
    sys.exit(main())
