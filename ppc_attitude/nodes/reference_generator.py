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

"""The reference generator: publishes the desired attitude, rate and acceleration."""

import sys
from collections.abc import Mapping
from functools import partial

from ppc_attitude.contract.topics import REFERENCE
from ppc_attitude.nodes.component_node import ComponentNode
from ppc_attitude.nodes.guidance_desk import GuidanceDesk
from ppc_attitude.nodes.running import run_node
from ppc_attitude.runtime.health import OK, WARN, Status
from ppc_attitude.runtime.stamps import RefusedError, Values
from ppc_attitude.science.references import goal
from ppc_attitude.science.stamps import NANOSECONDS, seconds

_STRIDE = 10_000 * NANOSECONDS  # [ns] to integrate the paper's motion over it takes 0.2 s


class ReferenceGenerator(ComponentNode):
    """Desired attitude, rate and acceleration; in mode `goal` it takes goals in flight."""

    executable = REFERENCE

    def __init__(self) -> None:
        super().__init__()
        self._reached = 0  # the latest instant [ns] from which the motion goes on
        (part,) = self.chain.parts
        self._desk = GuidanceDesk(self, part) if part.component is goal.COMPONENT else None

    def apply_parameters(self, stamp_ns: int) -> None:
        """Take over parameters; the goals that were given in flight stay."""
        self._reached = 0
        super().apply_parameters(stamp_ns)
        if self._desk:
            self._desk.configure()

    def arm(self) -> None:
        """Forget the past; the goals that were given in flight stay."""
        self._reached = 0
        super().arm()
        if self._desk:
            self._desk.tell_again()

    def forget_orders(self) -> str:
        """Forget the goals that were given in flight."""
        return "goals in flight" if self._desk and self._desk.begin_again() else ""

    def compute(self, stamp_ns: int, inputs: Mapping[str, Values]) -> dict[str, Values]:
        """Desired motion of an instant, with the goals that have come."""
        if self._desk:
            self._desk.before(stamp_ns)
        self._catch_up(stamp_ns)
        outputs = super().compute(stamp_ns, inputs)
        if self._desk:
            self._desk.after(stamp_ns)
        return outputs

    def _catch_up(self, stamp_ns: int) -> None:
        """Integrate a motion that depends on time alone in strides, between which the node may end.

        A node that joins a run late, or hears a bridge whose clock began long ago, may need days.
        """
        reached = self._reached if self._reached <= stamp_ns else 0
        while not self.chain.inputs and stamp_ns - reached > _STRIDE:
            text = f"{seconds(reached):.0f} s of {seconds(stamp_ns):.0f} s"
            if self.finished or self.is_asked_to_end():
                raise RefusedError(f"the state of {seconds(stamp_ns):.0f} s: the node ends first")
            self.complain("late", f"integrating the motion from zero to the state's stamp: {text}")
            self.wake()
            reached += _STRIDE
            self.chain.step(reached, {})
        self._reached = stamp_ns

    def status(self) -> Status:
        """Status of every component node, or a warning while the guidance has one."""
        status = super().status()
        concern = self._desk.concern if self._desk else ""
        if status.level == OK and concern:
            return Status(WARN, f"the desired motion {concern}", status.details)
        return status


main = partial(run_node, ReferenceGenerator)

if __name__ == "__main__":
    sys.exit(main())
