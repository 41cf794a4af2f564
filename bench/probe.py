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

"""Send states at a rate and time the answers: `python -m bench.probe RATE SECONDS`.

Prints the round trips [s] as a JSON list; an answer that never came is null.
"""

import json
import sys
import time

from bench.bare_peer import Peer, spinning
from ppc_attitude.contract.cdr import header_stamp
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    ATTITUDE,
    REFERENCE_ACCELERATION,
    REFERENCE_ATTITUDE,
    REFERENCE_RATE,
    TORQUE_COMMAND,
)
from ppc_attitude.science.stamps import stamp_of

# The attitude goes last: with it the instant is complete, and the bare echo answers it.
_INPUTS = (REFERENCE_ATTITUDE, REFERENCE_RATE, REFERENCE_ACCELERATION, ANGULAR_VELOCITY, ATTITUDE)
_SETTLED = 0.25  # [s] of answers that are not counted: first logs, caches
_PATIENCE = 5.0  # [s] for the last answers


class Probe(Peer):
    """Sends an instant and notes when its answer comes."""

    def __init__(self, rate: float) -> None:
        super().__init__("probe")
        self._rate = rate
        self._send = self.sender(_INPUTS)
        self.sent: dict[int, float] = {}
        self.answered: dict[int, float] = {}
        self.taker(TORQUE_COMMAND, self._take)

    def _take(self, data: bytes) -> None:
        now = time.perf_counter()
        self.answered.setdefault(header_stamp(data, TORQUE_COMMAND.msgtype) or 0, now)

    def send(self, step: int) -> None:
        """Send the messages of one instant."""
        stamp = stamp_of(step, self._rate)
        self._send(stamp)
        self.sent[stamp] = time.perf_counter()


def main() -> None:
    """Probe whoever answers with a torque command."""
    rate, seconds = float(sys.argv[1]), float(sys.argv[2])
    with spinning(lambda: Probe(rate)) as (probe, executor):
        step, last = 0, None
        due = time.perf_counter()
        while last is None or step <= last:
            now = time.perf_counter()
            if now < due:
                executor.spin_once(timeout_sec=due - now)
                continue
            if last is None and len(probe.answered) >= _SETTLED * rate:  # what counts begins here
                probe.sent.clear()
                last = step + round(rate * seconds)
            probe.send(step)
            step += 1
            due = max(due + 1.0 / rate, now)
        end = time.perf_counter() + _PATIENCE
        # Only the last is looked for: to look for all takes as long as a message at 1 kHz may.
        while stamp_of(step - 1, rate) not in probe.answered and time.perf_counter() < end:
            executor.spin_once(timeout_sec=0.05)
        trips = [
            probe.answered[stamp] - sent if stamp in probe.answered else None
            for stamp, sent in probe.sent.items()
        ]
        print(json.dumps(trips), flush=True)


if __name__ == "__main__":
    main()
