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

"""Orders to guidance: goals, holds and timed profiles, scheduled or given in flight."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.attitude import unit_quaternion
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.guidance.cones import each
from ppc_attitude.science.guidance.frames import FRAME_NAMES
from ppc_attitude.science.parameter import Parameter
from ppc_attitude.science.stamps import nanoseconds, seconds

HOLDING = "hold"  # in place of a frame's name
GOAL_TIMES = Parameter(
    "goals.times",
    [],
    "when each scheduled goal comes, in this order",
    "s",
    low=0.0,
    high=1e8,
    read_only=True,
)
GOAL_FRAMES = Parameter(
    "goals.frames",
    ["inertial"],
    "frame of each scheduled goal, or `hold` to brake and stay; once each, or one for all",
    choices=(*FRAME_NAMES, HOLDING),
    read_only=True,
)
GOAL_ATTITUDES = Parameter(
    "goals.attitudes",
    [],
    "attitude of each scheduled goal in its frame, x y z w each; normalised if within 1e-3",
    length=-4,
    read_only=True,
)
_OWN_TOLERANCE = 1e-12  # of the norm of a quaternion that is normalised
GOAL_PARAMETERS = (GOAL_TIMES, GOAL_FRAMES, GOAL_ATTITUDES)

HOLD, PROFILE = -1, -2  # in place of an order's frame
ORDER = np.dtype(
    [
        ("stamp_ns", np.int64),  # from when it holds; they come in this order
        ("frame", np.int64),  # of the goal; `HOLD`; or `PROFILE`, a timed profile
        ("attitude", np.float64, (4,)),  # of the goal, x y z w
        ("points", np.uint64),  # address of the profile, dtype `POINTS`
    ],
    align=True,
)


def goal_order(stamp_ns: int, frame: str, attitude: Sequence[float]) -> NDArray[Any]:
    """One goal (array of dtype `ORDER`, length 1) from a stamp on.

    Raises
    ------
    ConfigurationError
        The attitude is not unit within 1e-3, or nobody knows the frame.
    """
    if frame not in FRAME_NAMES:
        raise ConfigurationError(f"frame of a goal = {frame!r}; allowed: {', '.join(FRAME_NAMES)}")
    unit = unit_quaternion("attitude of a goal", attitude)
    if abs(math.hypot(*attitude) - 1.0) <= _OWN_TOLERANCE:
        unit = np.asarray(attitude, np.float64)  # to normalise it again would change its last bits
    return np.array([(stamp_ns, FRAME_NAMES.index(frame), tuple(unit), 0)], ORDER)


def hold_order(stamp_ns: int) -> NDArray[Any]:
    """Order to brake in inertial space from a stamp on and to stay there."""
    return np.array([(stamp_ns, HOLD, (0.0, 0.0, 0.0, 1.0), 0)], ORDER)


def profile_order(stamp_ns: int, points: NDArray[Any]) -> NDArray[Any]:
    """Order to follow a timed profile: an array of dtype `POINTS`, length 1, which must be kept."""
    return np.array([(stamp_ns, PROFILE, (0.0, 0.0, 0.0, 1.0), points.ctypes.data)], ORDER)


def scheduled_orders(values: Mapping[str, Any]) -> NDArray[Any]:
    """Goals of a scenario, array of dtype `ORDER`, from checked parameter values.

    Raises
    ------
    ConfigurationError
        Times, frames and attitudes are not equally many, times are not in order, or an attitude is
        not unit.
    """
    times = values[GOAL_TIMES.name]
    attitudes = np.reshape(values[GOAL_ATTITUDES.name], (-1, 4))
    frames = each(GOAL_FRAMES.name, values[GOAL_FRAMES.name], len(times))
    if len(attitudes) != len(times):
        raise ConfigurationError(
            f"{GOAL_TIMES.name} has {len(times)} values, {GOAL_ATTITUDES.name} {attitudes.size}; "
            "allowed: n and 4 n"
        )
    if any(later < earlier for earlier, later in pairwise(times)):
        raise ConfigurationError(
            f"{GOAL_TIMES.name} = {list(times)}; allowed: none before the last"
        )
    orders = [
        hold_order(nanoseconds(time))
        if frame == HOLDING
        else goal_order(nanoseconds(time), frame, attitude)
        for time, frame, attitude in zip(times, frames, attitudes, strict=True)
    ]
    return np.concatenate([np.zeros(0, ORDER), *orders])


def schedule_of(orders: NDArray[Any]) -> dict[str, Any]:
    """Parameter values that schedule some orders: the inverse of `scheduled_orders`.

    Timed profiles are left out: no parameter holds one.
    """
    kept = orders[orders["frame"] != PROFILE]
    return {
        GOAL_TIMES.name: [seconds(int(stamp_ns)) for stamp_ns in kept["stamp_ns"]],
        GOAL_FRAMES.name: [HOLDING if i == HOLD else FRAME_NAMES[i] for i in kept["frame"]],
        GOAL_ATTITUDES.name: kept["attitude"].ravel().tolist(),
    }
