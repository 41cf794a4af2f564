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

"""The orders of a run, scheduled and given in flight, in the order in which they act."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.stamps import seconds

_MOST = 10_000

Make = Callable[[int], NDArray[Any]]
"""From the stamp [ns] at which an order acts to the order: array of dtype `ORDER`, length 1."""


class OrderBook:
    """Orders, of which those that have acted come first.

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
        """Take an order that acts from a stamp [ns] on; what is past acts at the next instant.

        Returns
        -------
        str
            From when it acts, in words.

        Raises
        ------
        ConfigurationError
            There are too many orders.
        """
        if len(self._orders) + len(self._beginning) >= _MOST:
            raise ConfigurationError(f"{_MOST} orders were given; allowed: no more in one run")
        self.in_flight += 1
        if stamp_ns <= self._stamp:
            self._beginning.append(make)
            return "from the next state on"
        self._insert(make(stamp_ns))
        return f"from t = {seconds(stamp_ns):.6f} s on"

    def _insert(self, order: NDArray[Any]) -> None:
        orders = np.concatenate([self._orders, order])
        self._orders = orders[np.argsort(orders["stamp_ns"], kind="stable")]
        self._changed = True

    def at(self, stamp_ns: int) -> NDArray[Any] | None:
        """Let act what waits for the next instant [ns]; all orders, if they have changed."""
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
