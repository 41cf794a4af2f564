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

"""Settling from t = 0 for a reference that is known: the axis of the error bounds the speed.

n has the same numbers in the desired frame and turns by ν‖ω_⊥‖ only, so b = n·ω_d(t) is known up to
a cell of n and what n may have turned: V is larger than its least value most of the time. The cells
cover the sphere, and the angles for which the bound for any reference is not shorter.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.controllers.brake import capped_brake
from ppc_attitude.science.guarantee.arithmetic import FLOATS
from ppc_attitude.science.guarantee.assumptions import Assumptions, Law
from ppc_attitude.science.guarantee.bounds import Bounds
from ppc_attitude.science.guarantee.cells import nu_of
from ppc_attitude.science.guarantee.envelope import Envelope
from ppc_attitude.science.kernel import kernel

Array = NDArray[np.float64]
_STEP = 0.02  # [s], or longer for a slow craft
_PADDING = 1e-9  # relative, of every step: plain floats, rounded
# Cells along an edge of the cube whose faces cover the sphere: those that settle late are divided.
_FACES = (14, 28, 56)
_LATE = 1.0  # [s] cells that settle this short before the last one are divided
_STEPS = 20_000  # before which every cell has settled
_ARRAYS = FLOATS._replace(sin=np.sin)


@dataclass
class _State:
    """Bounds on every cell: largest and least φ, what n may have turned, least speed σ."""

    above: Array
    below: Array
    turned: Array
    sigma: Array


def _sphere_cells(face: int) -> tuple[Array, Array]:
    """Centres of cells that cover the unit sphere, and the largest angle [rad] to a point of each.

    Their edges are arcs of great circles, so no point is farther from the centre than a corner.
    """
    edges = np.tan(np.linspace(-np.pi / 4, np.pi / 4, face + 1))
    u, v = (each.ravel() for each in np.indices((face, face)))

    def points(a: Array, b: Array) -> Array:
        plane = np.stack([a, b, np.ones_like(a)], axis=1)
        return np.asarray(plane / np.linalg.norm(plane, axis=1, keepdims=True))

    centres = points(0.5 * (edges[u] + edges[u + 1]), 0.5 * (edges[v] + edges[v + 1]))
    corners = [points(edges[u + i], edges[v + j]) for i in (0, 1) for j in (0, 1)]
    radius = np.max([np.arccos(np.sum(centres * each, axis=1)) for each in corners], axis=0)
    sides = [np.roll(sign * centres, k, axis=1) for k in range(3) for sign in (1.0, -1.0)]
    return np.concatenate(sides), np.tile(radius, 6)


def _divided(cells: NDArray[np.int64], face: int) -> NDArray[np.int64]:
    """Places of the four parts of each cell among those of twice as many along an edge."""
    side, place = np.divmod(cells, face * face)
    u, v = np.divmod(place, face)
    parts = [(side * 2 * face + 2 * u + i) * 2 * face + 2 * v + j for i in (0, 1) for j in (0, 1)]
    return np.concatenate(parts)


class KnownReference:
    """Settling times of one law for one reference.

    Parameters
    ----------
    assumed : Assumptions
        Assumptions, with bounds that the reference keeps.
    law : Law
        Numbers that satisfy the inequalities.
    rate_at : callable
        Returns ω_d [rad/s], shape (n, 3), at instants [s], shape (n,).
    ahead : ndarray, shape (3,)
        Θ [rad] that the law is told at the start; zeros for a law that is told nothing.
    """

    def __init__(
        self, assumed: Assumptions, law: Law, rate_at: Callable[[Array], Array], ahead: Array
    ) -> None:
        self._assumed, self._law, self._rate_at, self._ahead = assumed, law, rate_at, ahead
        self._lead = min(float(np.linalg.norm(ahead)), assumed.lead)
        self._bounds = Bounds(assumed, law, FLOATS)
        self._envelope = Envelope(self._bounds)
        self._step = _STEP

    def time(self, rate: float, accuracy: float) -> float:
        """Guaranteed settling time [s] from t = 0, for every attitude.

        Parameters
        ----------
        rate : float
            Largest ‖ω_s‖ at the start [rad/s].
        accuracy : float
            Settled means |q_ev,i| < accuracy.

        Raises
        ------
        ValueError
            The rate is beyond that of a cruise.
        """
        rate += float(np.linalg.norm(self._rate_at(np.zeros(1)))) * (1.0 + _PADDING)
        rate = self._envelope.told(rate)
        if rate > self._law.w_far:
            raise ValueError(
                f"rate error = {rate:g} rad/s; allowed in a cruise: at most {self._law.w_far:g}"
            )
        near = self._envelope.near_time(self._law.far, rate, accuracy)
        longest = near
        # The time to be found is at most that for any reference, which takes half of the steps.
        any_reference = self._envelope.far_time(math.pi + self._lead, rate, accuracy)
        self._step = max(_STEP, 2.0 * any_reference / _STEPS)
        for start in np.linspace(np.pi, self._law.far, 40):
            # From here on down the bound for any reference is no longer than what is found.
            bound = self._envelope.far_time(float(start) + self._lead, rate, accuracy)
            if bound <= longest:
                break
            angles = float(start) - 0.15, float(start)
            longest = max(longest, self._longest(angles, rate, accuracy, longest))
        else:
            longest = max(longest, bound)
        return longest

    def _longest(
        self, angles: tuple[float, float], rate: float, accuracy: float, known: float
    ) -> float:
        """Time for every start between two angles [rad], to each of which n·Θ is added.

        It is only found roughly if it is less than the known time [s].
        """
        longest = 0.0
        cells: NDArray[np.int64] = np.arange(6 * _FACES[0] ** 2)
        for face in _FACES:
            centres, radius = _sphere_cells(face)
            times = self._times(centres[cells], radius[cells], angles, rate, accuracy)
            late = times > max(times.max() - _LATE, known)
            if face == _FACES[-1] or not late.any():
                break
            longest = max(longest, times[~late].max(initial=0.0))
            cells = _divided(cells[late], face)
        return max(longest, float(times.max()))

    def _times(
        self,
        centres: Array,
        radius: Array,
        angles: tuple[float, float],
        rate: float,
        accuracy: float,
    ) -> Array:
        """Time [s] for each cell of n, with φ between two angles + n·Θ [rad] at the start."""
        law, assumed = self._law, self._assumed
        # The law goes by what it is told of n and φ.
        size = float(np.linalg.norm(self._ahead))
        along, spread = centres @ self._ahead, size * (radius + assumed.e_A) + assumed.e_A
        least = angles[0] + np.clip(along - spread, -assumed.lead, assumed.lead)
        most = angles[1] + np.clip(along + spread, -assumed.lead, assumed.lead)
        least = np.maximum(least, law.far)  # what is nearer does not cruise
        drift, begin = self._envelope.stop(rate)
        count = len(radius)
        nu = np.maximum(nu_of(least - 1.5 * drift, _ARRAYS), nu_of(most + drift, _ARRAYS))
        state = _State(
            above=most + assumed.e_A + drift,
            # σ = −n·ω_e ≤ rate is kept while the rest stops.
            below=least - assumed.e_A - drift - rate * begin,
            turned=nu * (drift + assumed.e_A),
            sigma=np.zeros(count),
        )
        found = np.zeros(count)
        cells: NDArray[np.int64] = np.arange(count)
        longest = _STEPS * self._step
        times = begin + self._step * np.arange(round((longest - begin) / self._step))
        for t, omega_d in zip(times, self._rate_at(times), strict=True):
            keep = state.above > 2.0 * accuracy
            if not keep.all():
                found[cells[~keep]] = t
                cells, centres, radius = cells[keep], centres[keep], radius[keep]
                state = _State(*(each[keep] for each in vars(state).values()))
            if not keep.any():
                return found
            self._advance(state, centres @ omega_d, radius, float(np.linalg.norm(omega_d)))
        raise ValueError(f"no settling within {longest:g} s")

    def _advance(self, state: _State, along: Array, radius: Array, size: float) -> None:
        """Carry the bounds over a step in which the reference is near ω_d."""
        law, assumed, step = self._law, self._assumed, self._step
        change = assumed.W1 * step
        size = min(size + change, assumed.W)
        spread = size * (radius + state.turned) + change
        slow, fast = along - spread, np.minimum(along + spread, size)
        slow = np.maximum(slow, -size)
        root = law.Omega_e**2 - size * size
        least = slow + np.sqrt(slow * slow + root) - law.h * law.V_rate
        most = fast + np.sqrt(fast * fast + law.Omega_e**2 - max(size - 2.0 * change, 0.0) ** 2)
        cap = np.minimum(state.sigma, least)
        brake = law.k, float(self._bounds.a)
        # An upper solution falls by no more in a step than at the speed of its beginning.
        fastest = speeds(state.above, cap, *brake) * (1.0 + _PADDING)
        lowest = np.maximum(state.above - step * fastest, 0.0)
        fall = speeds(lowest, cap, *brake) * (1.0 - _PADDING)
        nu = np.maximum(
            nu_of(np.clip(state.below, 1e-3, np.pi), _ARRAYS),
            nu_of(np.minimum(state.above, 2 * np.pi - 1e-3), _ARRAYS),
        )
        state.turned += step * law.z_bar * nu * (1.0 + _PADDING)
        state.above += step * (law.z_bar - fall)
        rise = np.minimum(most, law.k * np.maximum(state.below, 0.0))
        state.below -= step * (law.z_bar + rise) * (1.0 + _PADDING)
        state.sigma += step * float(self._bounds.reserve) * (1.0 - _PADDING)


@kernel
def speeds(phi: Array, cap: Array, k: float, a: float) -> Array:
    """f(φ; V) [rad/s] of the law itself, on arrays of shape (n,); a cap below 0 counts as 0."""
    found = np.empty_like(phi)
    for i in range(phi.size):
        found[i] = capped_brake(phi[i], k, a, max(cap[i], 0.0))[0]
    return found
