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

"""What stands between a law and the torque it asks for: a switch, a limit, and a known attitude."""

from collections.abc import Sequence

from ppc_attitude.contract.topics import ATTITUDE, TORQUE_COMMAND
from ppc_attitude.runtime.health import OK, STALE, WARN, Status
from ppc_attitude.runtime.stamps import Values
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.stamps import seconds

_ZERO = (0.0, 0.0, 0.0)
_NO_ATTITUDE = f"{ATTITUDE.name} is all zeros, so the attitude is unknown: zero torque"
_UNSATURATED = "unsaturated_torque"  # of a law that has a limit


class TorqueGate:
    """Passes on a law's torque while it is enabled; counts what its limit took off.

    Attributes
    ----------
    enabled : bool
        False: the torque is zero, whatever the law asks for.
    saturated : int
        Steps in which the law asked for more than the limit.
    """

    def __init__(self) -> None:
        self.enabled = True
        self.saturated = 0
        self._switched = False  # `enabled` has changed, and the change is not yet on record
        self._sees = self._has_seen = False  # an attitude is known now; one has been known before

    def turn(self, enabled: bool) -> tuple[bool, str]:
        """Switch the torque; return whether the law begins anew, and what to tell who asked."""
        was, self.enabled = self.enabled, enabled
        self._switched = self._switched or enabled != was
        if not enabled:
            return False, "disabled: zero torque"
        if was:
            return False, "enabled already: the law goes on"
        return True, "enabled: re-armed from the present error"

    def has_switched(self) -> bool:
        """Return True once after the torque was switched."""
        switched, self._switched = self._switched, False
        return switched

    def look(self, stamp_ns: int, attitude: Sequence[float]) -> list[Advice]:
        """Tell if the attitude, all zeros while it is unknown, is lost or found at a stamp [ns].

        That there is none at first is not told, because a filter needs a while.
        """
        sees = any(attitude)
        if sees == self._sees:
            return []
        self._sees, had_seen = sees, self._has_seen
        self._has_seen = True
        text = f"{ATTITUDE.name} is known again" if sees else _NO_ATTITUDE
        return [Advice(f"{text} from t = {seconds(stamp_ns):.3f} s on", not sees)] * had_seen

    def passed(self, outputs: dict[str, Values], limit: float) -> dict[str, Values]:
        """Return what a law gives, by column; its torque is zero unless the gate is enabled."""
        if not self.enabled:
            return {**outputs, TORQUE_COMMAND.column: _ZERO}
        self.saturated += max(map(abs, outputs.get(_UNSATURATED, _ZERO))) > limit
        return outputs

    def status(self, status: Status) -> Status:
        """Say in the status of the law's node that its torque is zero, where it is."""
        if not self.enabled and status.level != STALE:
            return Status(WARN, "disabled: zero torque", status.details)
        if not self._sees and status.level == OK:
            return Status(WARN, _NO_ATTITUDE, status.details)
        return status
