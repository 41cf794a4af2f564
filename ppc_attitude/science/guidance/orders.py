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

"""Orders to guidance: goals, holds and timed profiles, scheduled or given in flight.

The order book of a run has them in the order in which they act.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.attitude import unit_quaternion
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.guidance.cones import one_for_each
from ppc_attitude.science.guidance.frames import FRAME_NAMES
from ppc_attitude.science.guidance.trajectory import POINTS, points
from ppc_attitude.science.kernel import STRAIGHT
from ppc_attitude.science.parameter import at_start, record_type
from ppc_attitude.science.stamps import LATEST, NANOSECONDS, nanoseconds, seconds

HOLDING, PROFILING = "hold", "profile"  # in place of a frame's name
GOAL_TIMES = at_start(
    "goals.times",
    [],
    "time of each scheduled goal, none before its predecessor",
    "s",
    low=0.0,
    high=LATEST,
)
GOAL_FRAMES = at_start(
    "goals.frames",
    ["inertial"],
    "frame of each scheduled goal, or `hold` to brake and stay, or `profile` to go through "
    "goals.points; once each, or one for all",
    choices=(*FRAME_NAMES, HOLDING, PROFILING),
)
GOAL_ATTITUDES = at_start(
    "goals.attitudes",
    [],
    "attitude of each scheduled goal in its frame, x y z w each; normalised if within 1e-3; "
    "ignored for `hold` and `profile`",
    length=-4,
    quaternion=True,
)
_POINT = 12
GOAL_POINTS = at_start(
    "goals.points",
    [],
    "points of timed profiles, 12 numbers each: number of its goal, counted from 0; "
    "time [s]; inertial attitude x y z w; rate [rad/s] and acceleration [rad/s²], desired frame",
    length=-_POINT,
)
_MOST = 10_000  # orders that wait, or are kept for a reference that begins anew
GOAL_PARAMETERS = (GOAL_TIMES, GOAL_FRAMES, GOAL_ATTITUDES, GOAL_POINTS)

HOLD, PROFILE = -1, -2  # in place of an order's frame
ORDER = record_type(
    ("stamp_ns", np.int64),  # from when it holds; they come in this order
    ("frame", np.int64),  # of the goal; `HOLD`; or `PROFILE`, a timed profile
    ("attitude", np.float64, (4,)),  # of the goal, x y z w
    ("profile", np.int64),  # number of the timed profile
)


class Orders(NamedTuple):
    """Orders to the reference."""

    listed: NDArray[Any]  # dtype `ORDER`, by their stamps
    profiles: NDArray[Any]  # dtype `POINTS`: timed profiles, to which orders refer by number


def goal_order(stamp_ns: int, frame: str, attitude: Sequence[float]) -> NDArray[Any]:
    """One goal (array of dtype `ORDER`, length 1) from a stamp on.

    Raises
    ------
    ConfigurationError
        The norm of the attitude is not 1 within 1e-3, or the frame is unknown.
    """
    if frame not in FRAME_NAMES:
        raise ConfigurationError(f"frame of a goal = {frame!r}; allowed: {', '.join(FRAME_NAMES)}")
    unit = unit_quaternion("attitude of a goal", attitude)
    return np.array([(stamp_ns, FRAME_NAMES.index(frame), unit, 0)], ORDER)


def hold_order(stamp_ns: int) -> NDArray[Any]:
    """Order to brake in inertial space from a stamp on and to stay there."""
    return np.array([(stamp_ns, HOLD, STRAIGHT, 0)], ORDER)


def profile_order(stamp_ns: int, number: int) -> NDArray[Any]:
    """Order to follow a timed profile, by its number among the profiles."""
    return np.array([(stamp_ns, PROFILE, STRAIGHT, number)], ORDER)


def scheduled_orders(values: Mapping[str, Any]) -> Orders:
    """Goals of a scenario from checked parameter values.

    Raises
    ------
    ConfigurationError
        Times, frames and attitudes are not equally many, times are not in order, an attitude is
        not unit, or the points of a profile are not allowed.
    """
    times = values[GOAL_TIMES.name]
    attitudes = np.reshape(values[GOAL_ATTITUDES.name], (-1, 4))
    frames = one_for_each(GOAL_FRAMES.name, values[GOAL_FRAMES.name], len(times))
    if len(attitudes) != len(times):
        raise ConfigurationError(
            f"{GOAL_TIMES.name} has {len(times)} values, {GOAL_ATTITUDES.name} {attitudes.size}; "
            "allowed: n and 4 n"
        )
    if any(later < earlier for earlier, later in pairwise(times)):
        raise ConfigurationError(
            f"{GOAL_TIMES.name} = {list(times)}; allowed: none before its predecessor"
        )
    rows = np.reshape(values[GOAL_POINTS.name], (-1, _POINT))
    owners = {i for i, frame in enumerate(frames) if frame == PROFILING}
    strays = sorted(set(rows[:, 0].tolist()) - owners)
    if strays:
        raise ConfigurationError(
            f"{GOAL_POINTS.name} has points of goal {strays[0]:g}; allowed: goals with the frame "
            f"{PROFILING}, which are {sorted(owners)}"
        )
    orders, profiles = [np.zeros(0, ORDER)], list[Any]()
    for i, (time, frame, attitude) in enumerate(zip(times, frames, attitudes, strict=True)):
        stamp_ns = nanoseconds(time)
        if frame == HOLDING:
            orders.append(hold_order(stamp_ns))
        elif frame == PROFILING:
            own = rows[rows[:, 0] == i]
            orders.append(profile_order(stamp_ns, len(profiles)))
            profiles.append(points(own[:, 1].tolist(), own[:, 2:6], own[:, 6:9], own[:, 9:]))
        else:
            orders.append(goal_order(stamp_ns, frame, attitude))
    return Orders(np.concatenate(orders), np.array(profiles, POINTS))


def schedule_of(orders: Orders) -> dict[str, Any]:
    """Parameter values that schedule some orders: the inverse of `scheduled_orders`."""
    names = {HOLD: HOLDING, PROFILE: PROFILING, **dict(enumerate(FRAME_NAMES))}
    rows = []
    for i in np.flatnonzero(orders.listed["frame"] == PROFILE):
        each = orders.profiles[orders.listed["profile"][i]]
        for k in range(each["count"]):
            motion = (each["attitude"][k], each["rate"][k], each["acceleration"][k])
            rows.append([i, each["time"][k], *np.concatenate(motion)])
    return {
        GOAL_TIMES.name: (orders.listed["stamp_ns"] / NANOSECONDS).tolist(),
        GOAL_FRAMES.name: [names[int(frame)] for frame in orders.listed["frame"]],
        GOAL_ATTITUDES.name: orders.listed["attitude"].ravel().tolist(),
        GOAL_POINTS.name: [float(number) for row in rows for number in row],
    }


Make = Callable[[int], NDArray[Any]]
"""From the stamp [ns] at which an order acts to the order: array of dtype `ORDER`, length 1."""


class OrderBook:
    """Orders, sorted by their stamps, scheduled and given in flight.

    Parameters
    ----------
    scheduled : ndarray of dtype ORDER
        Orders of the scenario.
    """

    def __init__(self, scheduled: NDArray[Any]) -> None:
        self._scheduled = scheduled
        self._orders = scheduled
        self._beginning: list[Make] = []  # act from the next instant on
        self.begin_again()

    def accept(self, make: Make, stamp_ns: int) -> str:
        """Take an order that acts from a stamp [ns] on; if that is past, from the next instant on.

        Returns
        -------
        str
            The stamp from which it acts, in words.

        Raises
        ------
        ConfigurationError
            Too many orders wait.
        """
        waiting = np.count_nonzero(self._orders["stamp_ns"] > self._stamp)
        if waiting + len(self._beginning) >= _MOST:
            raise ConfigurationError(f"{_MOST} orders wait; allowed: no more at a time")
        self.in_flight += 1
        if stamp_ns <= self._stamp:
            self._beginning.append(make)
            return "from the next state on"
        self._insert(make(stamp_ns))
        return f"from t = {seconds(stamp_ns):.6f} s on"

    def _insert(self, order: NDArray[Any]) -> None:
        orders = np.concatenate([self._orders, order])
        self._orders = orders[np.argsort(orders["stamp_ns"], kind="stable")][-_MOST:]
        self._changed = True

    def at(self, stamp_ns: int) -> NDArray[Any] | None:
        """Insert the orders that wait for the next instant [ns]; return all, if they changed."""
        self._stamp = stamp_ns
        for make in self._beginning:
            self._insert(make(stamp_ns))
        self._beginning.clear()
        changed, self._changed = self._changed, False
        return self._orders if changed else None

    def begin_again(self) -> None:
        """Forget what was given in flight, since time began again."""
        self._orders = self._scheduled
        self._beginning.clear()
        self.in_flight = 0  # how many came in flight
        self._stamp = -1  # the latest instant [ns] that was asked for
        self._changed = True
