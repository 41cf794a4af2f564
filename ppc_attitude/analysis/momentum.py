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

"""Momentum that the reaction wheels of a recorded run hold, and how much of their speed it takes.

Both need numbers of the wheels, which are the plant's parameters; a bag may lack them.
"""

from contextlib import suppress

import numpy as np

from ppc_attitude.analysis.series import has
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.science import wheels
from ppc_attitude.science.errors import ConfigurationError

RESERVE = 0.99
"""Largest share of its largest speed that a wheel may reach [1]."""


def wheel_shares(record: RunRecord) -> Array | None:
    """Recorded speeds of the wheels by their largest, shape (n, count); None if it is not told."""
    speeds = np.abs(record[wheels.SPEED.name])
    with suppress(KeyError, TypeError, ValueError):  # what somebody wrote into a bag
        limits = record.parameters[PLANT][wheels.MAX_SPEED.name]
        each = np.pad(limits, (0, speeds.shape[1] - len(limits)), mode="edge")  # one is for all
        return np.asarray(speeds / each)
    return None


def wheel_momentum(record: RunRecord) -> Array | None:
    """‖Σ J_s Ω a‖ [N·m·s] at each instant, shape (n,); None if nobody tells of the wheels."""
    if not has(record, wheels.SPEED.name):
        return None
    plant, speeds = record.parameters.get(PLANT, {}), record[wheels.SPEED.name]
    with suppress(KeyError, TypeError, ValueError, ConfigurationError):
        return np.asarray(np.linalg.norm(wheels.momenta(plant, speeds), axis=1))
    return None


def runs_out(shares: Array, t: Array) -> str:
    """Say which wheel first has more than `RESERVE` of its largest speed, and when [s], if any."""
    for first, wheel in np.argwhere(shares > RESERVE)[:1].tolist():
        return f"wheel {wheel} is above it from {t[first]:.6g} s on: momentum runs out"
    return ""
