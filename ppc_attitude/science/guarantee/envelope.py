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

"""How long the comparison system needs: an upper solution, in steps rounded upward.

φ' ≤ p‖ω_res‖ + z̄ − r f(φ; V_e) is a cooperative system (Comparison in docs/guarantee.md): what
starts above it stays above. The step takes f at the lowest φ that the step can reach.
"""

import math

from ppc_attitude.science.controllers.brake import BLEND
from ppc_attitude.science.guarantee.arithmetic import Number
from ppc_attitude.science.guarantee.bounds import Bounds
from ppc_attitude.science.guarantee.cells import saturated

_STEP = 0.01  # [s] or a sample, or this share of a turn, whichever is longest
_SHARE = 5e-5
_PATIENCE = 100_000  # steps


class Envelope:
    """The comparison system of a law under its assumptions, whose inequalities hold."""

    def __init__(self, bounds: Bounds) -> None:
        assumed, law, number = bounds.assumed, bounds.law, bounds.arithmetic.number
        self._assumed, self._law, self._bounds = assumed, law, bounds
        self._arithmetic = bounds.arithmetic
        # A slow craft gets no more steps than a quick one, but steps resolve the last exponential.
        h, k, Omega_e, W, a = map(float, (law.h, law.k, law.Omega_e, assumed.W, law.a_most))
        turn = math.pi / (Omega_e - W) + 2.0 * math.sqrt(math.pi / a)  # [s] about
        self._step = number(max(_STEP, h, min(_SHARE * turn, 0.2 / k)))
        self._slowest, self._fastest = law.Omega_e - assumed.W, law.Omega_e + assumed.W
        self._linear = bounds.a / (law.k * law.k)
        self._offset, self._offset_most = (
            a * a / (law.k * law.k) for a in (bounds.a, bounds.a_most)
        )
        self._zero = number(0.0)

    def told(self, rate: float) -> Number:
        """Largest ‖ω_e‖ [rad/s] that the law is told at an event with a true one up to `rate`."""
        return self._arithmetic.number(rate) + self._bounds.e_w

    def speed(self, phi: Number, cap: Number) -> Number:
        """f(φ; V), from below where a comparison is not certain."""
        arithmetic, g = self._arithmetic, self._law.k * phi
        if not phi <= self._linear:
            under = 2 * self._bounds.a * phi - self._offset
            g = arithmetic.least(g, arithmetic.sqrt(arithmetic.largest(under, self._zero)))
        if g >= (1 + BLEND) * cap:
            return cap
        if g <= (1 - BLEND) * cap:
            return g
        x = arithmetic.least(g / cap, arithmetic.number(1.0 + BLEND))
        return cap * saturated(x, arithmetic)

    def settled(self, accuracy: float) -> Number:
        """φ below which |q_ev,i| < accuracy: 2 asin(x) ≥ 2x."""
        return 2 * self._arithmetic.number(accuracy)

    def terminal(self) -> float:
        """Final bound of |q_ev,i| for any disturbance within its bound: z̄/(2k)."""
        return self._arithmetic.outward(self._law.z_bar / (2 * self._law.k))[1]

    def settling(self, rate: float, accuracy: float, turn: float = math.pi) -> float:
        """Guaranteed settling time [s], by default for every attitude.

        Parameters
        ----------
        rate : float
            Largest ‖ω_e‖ at the event [rad/s].
        accuracy : float
            Settled means |q_ev,i| < accuracy.
        turn : float
            Largest angle of the error at the event, the short way round [rad].

        Raises
        ------
        ValueError
            The accuracy is never guaranteed, or the rate is beyond omega0.
        """
        if self.terminal() >= accuracy:
            raise ValueError(
                f"|q_ev,i| < {accuracy:g} is never guaranteed: the tube leads to "
                f"z̄/(2k) = {self.terminal():.3g}"
            )
        told = self.told(rate)
        if not told <= self._law.omega0:
            raise ValueError(
                f"a rate error of {rate:g} rad/s may, with its estimation error, be larger than "
                f"omega0 = {float(self._law.omega0):g} rad/s"
            )
        return self._from_event(self._arithmetic.number(turn), told, accuracy)

    def _from_event(
        self, phi: Number, rate: Number, accuracy: float, stop: Number | None = None
    ) -> float:
        """Time [s] from an event at most φ [rad] away, at a rate [rad/s] as the law is told it.

        The length of a stop [s] that keeps no useful speed may be known.
        """
        law, pi, lead, e_A = self._law, self._arithmetic.pi, self._assumed.lead, self._assumed.e_A
        # Only an error that is told to be nearly half a turn may be turned the other way round.
        phi = phi if phi + e_A < pi - lead else pi + lead
        if not rate <= law.w_far or phi + e_A < law.far:
            # It covers starts that cruise: from the same turn they are no later, because σ ≥ r V.
            return self.near_time(phi, rate, accuracy, stop)
        near = self.near_time(law.far, rate, accuracy)
        return max(self.far_time(phi, rate, accuracy), near)

    def near_time(
        self, phi: Number, rate: Number, accuracy: float, stop: Number | None = None
    ) -> float:
        """Time [s] from φ [rad] where the brake sets in after a stop, whose length may be known.

        The rate [rad/s] is the one that the law is told.
        """
        arithmetic, step, one = self._arithmetic, self._step, self._arithmetic.number(1.0)
        z, e_A, k = self._law.z_bar, self._assumed.e_A, self._law.k
        drift, time = self.stop(rate, stop)
        reserve, limit = self._bounds.reserve, self.settled(accuracy)
        # An error that begins within the accuracy may still drift out while the brake sets in.
        phi = arithmetic.upper(arithmetic.largest(phi + e_A + drift, limit))
        r = arithmetic.number(0.0)
        for n in range(_PATIENCE):
            if phi < limit:
                return arithmetic.outward(time + n * step)[1]
            highest = phi + step * z + e_A  # φ within the step, as it is told
            above = self.speed_above(highest, self._fastest, self._bounds.a_most, self._offset_most)
            rising = reserve / above
            fall = r * self.speed(self._lowest(phi), self._slowest)
            phi = arithmetic.upper(phi + step * (z - fall))
            r = -arithmetic.upper(-arithmetic.least(r + step * arithmetic.least(k, rising), one))
        raise ValueError(f"no settling within {_PATIENCE} steps")

    def far_time(self, phi: Number, rate: Number, accuracy: float) -> float:
        """Time [s] from φ [rad] where the speed rises with the torque that is left."""
        arithmetic, step = self._arithmetic, self._step
        drift, time = self.stop(rate)
        phi = arithmetic.upper(phi + self._assumed.e_A + drift)
        limit, sigma = self.settled(accuracy), arithmetic.number(0.0)
        for n in range(_PATIENCE):
            if phi <= limit:
                return arithmetic.outward(time + n * step)[1]
            fall = self.speed(self._lowest(phi), sigma)
            phi = arithmetic.upper(phi + step * (self._law.z_bar - fall))
            risen = arithmetic.least(sigma + step * self._bounds.reserve, self._slowest)
            sigma = -arithmetic.upper(-risen)
        raise ValueError(f"no settling within {_PATIENCE} steps")

    def recovery(self, torque: float, duration: float, accuracy: float) -> float:
        """Guaranteed time [s] from the start of a hit to the recovery of a craft with φ ≤ z̄/k.

        It follows its brake at the start: whoever has just settled still moves faster than z̄.

        Parameters
        ----------
        torque : float
            Extra torque on the worst axis [N·m], constant.
        duration : float
            How long it acts [s].
        accuracy : float
            Recovered means |q_ev,i| < accuracy again, for good.

        Raises
        ------
        ValueError
            The hit may make the craft tumble, or lead out of the tube without being seen as a hit.
        """
        assumed, law = self._assumed, self._law
        # A torque above this leads out of the tube in one sample, whatever law and tube have
        # against it. Nor does a weak actuator explain it, of which the law would count on less.
        most = self._arithmetic.largest
        needed = most(
            *(
                most((y + n) / law.h, assumed.max_torque + 4 * n / law.h) + law.kappa * y
                for y, n in zip(law.Y, law.N, strict=True)
            )
        )
        certain = 1 - self._misled()
        if not certain > 0:
            told = f"e_S = {float(assumed.e_S):g}, so no recovery time is promised"
            raise ValueError(f"the law may not recognise a hit of a craft with {told}")
        seen = self._arithmetic.outward((3 * assumed.d + needed) / certain)[1]
        if torque <= seen:
            raise ValueError(
                f"the law may not recognise a hit of {torque:g} N·m, or take it for a weak "
                f"actuator: a recovery time is promised only of hits above {seen:.3g} N·m"
            )
        phi, rate, stop = self.after_hit(torque, duration)
        rest = self._from_event(phi, rate, accuracy, stop)
        time = self._arithmetic.number(duration) + law.h + self._arithmetic.number(rest)
        return self._arithmetic.outward(time)[1]

    def after_hit(self, torque: float, duration: float) -> tuple[Number, Number, Number]:
        """φ [rad], ‖ω_e‖ [rad/s] as the law is told it, and the length [s] of the stop after a hit.

        They hold at the sample that follows its end, for the torque [N·m] and the duration [s] of
        `recovery`.

        Raises
        ------
        ValueError
            The hit may make the craft tumble.
        """
        number, bounds = self._arithmetic.number, self._bounds
        assumed, law = self._assumed, self._law
        time, impulse = number(duration) + law.h, (1 + self._misled()) * number(torque) * duration
        # Until the event, after two samples at the latest, nothing is known of the law's torque;
        # nor later if it comes late. An event brakes each axis, so only what D_i bounds still
        # pushes, and what d̂ and N_i ask for beyond a saturated torque.
        blind = time if assumed.late > 0 else self._arithmetic.least(2 * law.h, time)
        rate = float(law.omega0)
        for _ in range(3):  # what is gained at a rate that is known not to be passed
            feedforward = bounds.feedforward(number(rate) + assumed.W + law.z_bar)
            besides = tuple(
                (assumed.d + assumed.max_torque + feedforward[i]) * blind
                + (bounds.D[i] + law.d_max + law.kappa * law.N[i]) * time
                + law.Y[i]
                + bounds.body.row[i] * (law.z_bar + bounds.e_w)  # as the law is told
                for i in range(3)
            )
            gained = tuple(impulse + each for each in besides)
            rate = self._arithmetic.outward(bounds.body.box(gained))[1]
            if rate > law.omega0:
                raise ValueError(
                    f"{torque:g} N·m for {duration:g} s may make the craft tumble: it may "
                    f"gain {rate:.3g} rad/s; a recovery time is promised only up to omega0 = "
                    f"{float(law.omega0):g} rad/s"
                )
        # Momentum that the hit has given lasts, in the mean, for half of it and a sample.
        turned = (impulse * (number(duration) / 2 + law.h) + each * time for each in besides)
        phi = law.z_bar / law.k + bounds.body.box(tuple(turned))
        # The momentum is known by axis, which ends the stop sooner than the rate alone would.
        left = zip(gained, bounds.left(feedforward), strict=True)
        stops = (momentum / each for momentum, each in left)
        return phi, number(rate), self._arithmetic.largest(*stops)

    def _misled(self) -> Number:
        """Share of a torque that a wrong inertia may add on an axis, or take, as the law sees y."""
        root = self._arithmetic.sqrt(self._arithmetic.number(3.0))
        return root * self._bounds.body.inverse_error(self._assumed.e_S)

    def speed_above(self, phi: Number, cap: Number, a: Number, offset: Number) -> Number:
        """Return an upper bound of f(φ; V) with a deceleration a: the lesser of g and V.

        `offset` is a²/k².
        """
        g = self._law.k * phi
        if g * self._law.k > a:
            g = self._arithmetic.sqrt(2 * a * phi - offset)
        return self._arithmetic.least(g, cap)

    def _lowest(self, phi: Number) -> Number:
        """φ after a step at the speed of its beginning, which an upper solution does not pass."""
        fastest = self.speed_above(phi, self._slowest, self._bounds.a, self._offset)
        return self._arithmetic.largest(phi - self._step * fastest, self._zero)

    def stop(self, rate: Number, known: Number | None = None) -> tuple[Number, Number]:
        """Drift of φ [rad] and time [s] of the stop phase, a sample more for what lands on one.

        Raises
        ------
        ValueError
            No torque is left to stop from ‖ω_e‖ = rate [rad/s], and no length [s] is known.
        """
        law, speed = self._law, self._arithmetic.number(rate)
        stop = self._bounds.stop_time(speed) if known is None else known
        if stop is None:
            raise ValueError(f"no torque is left to stop from {float(speed):g} rad/s")
        time = stop + 2 * law.h
        return speed * (stop + law.h) / 2 + law.z_bar * time, time
