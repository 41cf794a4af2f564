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

"""Everything that the proof bounds, for given assumptions and a given law (docs/guarantee.md)."""

from collections.abc import Callable

from ppc_attitude.science.controllers.brake import BLEND
from ppc_attitude.science.controllers.tube_parameters import observer_spread
from ppc_attitude.science.guarantee.arithmetic import Arithmetic, Number
from ppc_attitude.science.guarantee.assumptions import Assumptions, Law, exact
from ppc_attitude.science.guarantee.body import Body, Numbers
from ppc_attitude.science.guarantee.cells import (
    FINE,
    LARGEST,
    Cell,
    Cells,
    Speed,
    axis_error,
    axis_second,
    cells,
    half_cotangent,
    nu_of,
)


def _triple(function: Callable[[int], Number]) -> Numbers:
    """Value of a function of the axis for each axis."""
    return tuple(map(function, range(3)))


class Bounds:
    """Bounds in one arithmetic, sought on `count` cells of φ, of V and of a.

    Triples are per body axis.

    Raises
    ------
    ValueError
        Ω_e leaves no speed beyond the reference's, or the variation of F has no bound.
    """

    def __init__(
        self, assumed: Assumptions, law: Law, arithmetic: Arithmetic, count: Cells = FINE
    ) -> None:
        self.body = body = Body(assumed, arithmetic)
        self.assumed, self.law = assumed, law = exact(assumed, arithmetic), exact(law, arithmetic)
        self.arithmetic, most, e_S = arithmetic, arithmetic.largest, assumed.e_S
        # [s] of F while it acts, in the mean
        self._age = (arithmetic.number(0.5) + assumed.late) * law.h
        self.e_w = assumed.e_W + assumed.W * assumed.e_A  # [rad/s] largest error of ω_e
        self._most_used = _triple(lambda i: most(law.B[i], law.B_ramp))
        # [rad/s²] Least and largest deceleration of the brake about any axis.
        self.a, self.a_most = body.brakes(law.brake, law.a_most)
        reference = law.Omega_e, assumed.W, assumed.W1, assumed.W2
        errors = law.z_bar, assumed.e_A, self.e_w
        self._speed = Speed(law.k, self.a, self.a_most, *reference, *errors, arithmetic)
        self._stop_rate = law.omega0 + law.z_bar  # ‖ω_e‖ while p > 0
        self._cruise_rate = law.w_far + 2 * law.z_bar  # the axis turns meanwhile: C9 n
        self._fastest = most(assumed.Omega, self._stop_rate + assumed.W)
        epsilon = body.inverse_error(e_S)
        spread = ((1 + e_S) * body.most - (1 - e_S) * body.least) / 2
        # What a wrong inertia makes of rates and of torques [N·m].
        self._gyroscopic = (epsilon * spread + e_S * body.most) * self._fastest * self._fastest
        root = arithmetic.sqrt(arithmetic.number(3.0))
        self._misled = epsilon * root * (assumed.max_torque + assumed.d)

        # [rad] φ from which the cap alone acts, for the largest V.
        self.blend = self._reached((1 + BLEND) * (law.Omega_e + assumed.W), self.a)
        found = self._cells = self._main_cells(count)
        self.nu_stop = self._largest(nu_of, law.far / 2)  # ν in any stop phase of a cruise
        self._stop_cotangent = self._largest(half_cotangent, law.far / 2)
        # [rad/s²] What the turning axis needs while p > 0 in cruise.
        self.stop_load = self.nu_stop * (law.w_far * law.w_far / 2 + law.w_far * law.z_bar)
        # [N·m] Change of F within a sample: in the main phase, and while p > 0.
        self.variation = self._main_variation()
        self.variation_at_stop = self._stop_variation()
        lipschitz = most(*(each.lipschitz for each in found))
        # [N·m·s] N_i, and [N·m] N_F,i: change of F with the estimation errors, in any phase.
        self.noise = _triple(lambda i: body.row[i] * (self.e_w + lipschitz * assumed.e_A))
        self.torque_noise = self._torque_noise()
        feedforward = self.feedforward(assumed.Omega)
        needed = _triple(
            lambda i: most(*(each.needed(body.row[i], law.brake[i], arithmetic) for each in found))
        )
        # [N·m] What feedforward and brake need, and the T for which that would be all of B.
        self.load = _triple(lambda i: feedforward[i] + needed[i])
        self.brake = _triple(lambda i: law.B[i] - feedforward[i] - (needed[i] - law.brake[i]))
        left = zip(self.left(feedforward), body.row, strict=True)
        free = arithmetic.least(*(each / row for each, row in left))
        drift = most(*(arithmetic.sqrt(each.drift**2 + each.turn**2) for each in found))
        self.reserve = free - drift  # [rad/s²] a_r: left for a ramp by the F that the law is told
        # [rad/s²] Largest |V'| where the cap acts, with the error of its estimate in a sample; and
        # [rad/s³] largest |a'| where the brake acts.
        self.V_rate, self.a_rate = self._rates()
        self.z = body.box(law.Y)  # [rad/s] largest ‖Ĵ⁻¹y‖ in the tube
        self.B = self._allowed()  # [N·m] largest that the proof admits
        # [N·m] D_i bounds what the law does not compensate, the effect of N and N_F included
        self.D = self._uncompensated()
        self.Y = self._tube()  # [N·m·s] least that the proof admits

    def feedforward(self, rate: Number) -> Numbers:
        """M_i [N·m] for ‖ω_s‖ ≤ rate [rad/s].

        ω_e × w_d = ω_s × w_d, so ‖M0‖ needs ‖ω_s‖ and the reference only.
        """
        row, spread, W, W1 = self.body.row, self.body.spread, self.assumed.W, self.assumed.W1
        return _triple(lambda i: row[i] * (rate * W + W1) + spread[i] * rate * rate)

    def left(self, feedforward: Numbers) -> Numbers:
        """What is left of B [N·m] beside the feedforward, by the F that the law is told."""
        return _triple(lambda i: self.law.B[i] - feedforward[i] - self.torque_noise[i])

    def stop_time(self, rate: Number) -> Number | None:
        """T_p [s]: p is 0 after it if the event is told ‖ω_e‖ ≤ rate [rad/s]; None if never."""
        law = self.law
        feedforward = self.feedforward(rate + self.assumed.W + law.z_bar)
        cruises = bool(rate <= law.w_far)
        times = []
        for i, left in enumerate(self.left(feedforward)):
            if cruises:
                left = left - self.body.row[i] * self.stop_load
            if not left > 0:
                return None
            times.append(self.body.row[i] * rate / left)
        return self.arithmetic.largest(*times)

    def cruise_start(self) -> Number | None:
        """φ [rad] from which a cruise reaches its speed before it has to brake (C9), if any."""
        assumed, law = self.assumed, self.law
        time = self.stop_time(law.w_far)
        if time is None or not self.reserve > 0:
            return None
        fastest = law.Omega_e + assumed.W
        stopping = (law.w_far + self.e_w + law.z_bar) * (time + law.h)
        start = self.blend + stopping + assumed.e_A
        return start + fastest * fastest / (2 * self.reserve) + law.z_bar * fastest / self.reserve

    def _acceleration(self, rate: Number, variation: Numbers) -> Number:
        """A ≥ ‖ω_e'‖: v' from the most that |F| may be, and |y'| ≤ 2κY + δF."""
        feedforward = self.feedforward(rate)
        commanded = _triple(lambda i: self._most_used[i] + feedforward[i])
        tube = _triple(lambda i: 2 * self.law.kappa * self.law.Y[i] + variation[i])
        return self.body.box(commanded) + self.body.box(tube)

    def _feedforward_rate(self, i: int, w: Number, total: Number, acceleration: Number) -> Number:
        """Bound of |M0_i'| where ‖ω_e‖ ≤ w and ‖ω_s‖ ≤ total."""
        W, W1 = self.assumed.W, self.assumed.W1
        row, spread = self.body.row[i], self.body.spread[i]
        own = acceleration * W + w * (W1 + w * W) + self.assumed.W2 + w * W1
        return row * own + 2 * spread * total * (acceleration + W1 + w * W)

    def _main_cells(self, count: Cells) -> list[Cell]:
        """Cells from the least V: a σ that follows V may lag by what V moves in two samples."""
        Omega_e, W = self.law.Omega_e, self.assumed.W
        lag = 2 * self.law.h * self.law.V_rate
        lowest, _ = self.arithmetic.outward(Omega_e - W - lag)
        if lowest <= 0.0:
            raise ValueError(
                f"Omega_e = {float(Omega_e):g} rad/s leaves no speed beyond the reference's; "
                f"allowed: above W + 2 h V_rate, with W = {float(W):g} rad/s"
            )
        return cells(self._speed, lowest, count)

    def _main_variation(self) -> Numbers:
        """δF in the main phase: A depends on it, so it must be a fixed point."""
        guess = self._next_variation(self._next_variation((0.0,) * 3))  # from below
        # A δF that reproduces less than itself bounds the true one.
        inflated = _triple(lambda i: guess[i] * 1.002)
        variation = self._next_variation(inflated)
        if not all(bool(v <= w) for v, w in zip(variation, inflated, strict=True)):
            raise ValueError(
                "the variation of F within a sample has no bound: numbers of the law such as k, "
                "kappa, h and z_bar are out of proportion"
            )
        return inflated

    def _next_variation(self, variation: Numbers) -> Numbers:
        """δF in the main phase, with the ramps of r and σ, if A is taken with `variation`."""
        k, Omega = self.law.k, self.assumed.Omega
        A = self._acceleration(Omega, variation)
        sigma = 2 * A * self._largest(nu_of, self.blend) * self.law.z_bar  # σ' n', |σ'| ≤ ‖v'‖ ≤ A

        def axis(i: int) -> Number:
            rates = (
                self.body.row[i] * (each.second + each.lever * A + 2 * k * each.ramp + sigma)
                + self._feedforward_rate(i, each.speed, Omega, A)
                for each in self._cells
            )
            return self._age * self.arithmetic.largest(*rates)

        return _triple(axis)

    def _stop_variation(self) -> Numbers:
        """δF while p > 0: v' = p' ω_res, in cruise with σ n' besides."""
        W, fast, slow = self.assumed.W, self._stop_rate, self._cruise_rate
        total = fast + W
        A = self._acceleration(total, self.variation)
        turning = slow * axis_second(self.nu_stop, self._stop_cotangent, slow, slow, A)

        def axis(i: int) -> Number:
            near = self._feedforward_rate(i, fast, total, A)
            cruise = self._feedforward_rate(i, slow, slow + W, A) + self.body.row[i] * turning
            return self._age * self.arithmetic.largest(near, cruise)

        return _triple(axis)

    def _rates(self) -> tuple[Number, Number]:
        """V̄' and ā' where cap and brake act, with what their estimates may be wrong in a sample."""
        speed, law, h, W, e_A = self._speed, self.law, self.law.h, self.assumed.W, self.assumed.e_A
        fast, slow = law.Omega_e + W, law.Omega_e - W
        # The cap can act only beyond this φ; Φ's own step may look a little nearer.
        margin = 2 * h * (fast + self._stop_rate)
        nu_cap = self._nu_from(self._reached((1 - BLEND) * slow, self.a_most) - margin)
        # f depends on a beyond φ1 only, and φ rises by no more than h z̄ in a sample.
        nu_brake = self._nu_from(self.a / (law.k * law.k) - h * law.z_bar)
        return (
            speed.rate(nu_cap) + speed.gain * W * nu_cap * e_A / h,
            speed.brake_rate(self.a_most, nu_brake * (law.z_bar + e_A / h)),
        )

    def _torque_noise(self) -> Numbers:
        """N_F,i."""
        W, e_A, e_W, slow = self.assumed.W, self.assumed.e_A, self.assumed.e_W, self._cruise_rate
        stop = self.nu_stop, self._stop_cotangent
        turning = slow * axis_error(*stop, slow, slow + self.e_w, e_A, self.e_w)
        # A ramp changes f n by itself: r' ≤ k, or |σ'| ≤ ‖v'‖ ≤ A where the cap alone acts.
        A = self._acceleration(self.assumed.Omega, self.variation)
        rising = A * self._largest(nu_of, self.blend) * e_A
        most = self.arithmetic.largest
        ramps = (most(self.law.k * each.lipschitz * e_A, rising) for each in self._cells)
        pairs = zip(self._cells, ramps, strict=True)
        of_v = most(turning, *(each.error + ramp for each, ramp in pairs))
        of_m = W * e_W + (self._fastest * W + self.assumed.W1) * e_A

        def axis(i: int) -> Number:
            gyroscopic = self.body.spread[i] * e_W * (2 * self._fastest + e_W)
            return self.body.row[i] * (of_v + of_m) + gyroscopic

        return _triple(axis)

    def _reached(self, g: Number, a: Number) -> Number:
        """φ at which the brake allows g ≥ a/k: less for a stronger one."""
        return g * g / (2 * a) + a / (2 * self.law.k * self.law.k)

    def _nu_from(self, phi: Number) -> Number:
        """ν at φ, which is the largest up to half a turn; infinite where φ may be 0."""
        return nu_of(phi, self.arithmetic) if phi > 0 else self.arithmetic.number(float("inf"))

    def _largest(self, of: Callable[[Number, Arithmetic], Number], phi: Number) -> Number:
        """Largest value, from φ to the end of the cells, of what is largest at one of its ends."""
        arithmetic = self.arithmetic
        end = arithmetic.pi + LARGEST
        return arithmetic.largest(of(phi, arithmetic), of(end, arithmetic))

    def _allowed(self) -> Numbers:
        """Largest B: a saturated axis is still pushed back."""
        assumed = self.assumed
        common = assumed.eta * assumed.max_torque - assumed.d - assumed.dead_band
        common = common - self._misled - self._gyroscopic
        return _triple(lambda i: common - self.variation[i] - self.torque_noise[i])

    def _tube(self) -> Numbers:
        """Least Y: D/κ_eff + kick; infinite if the observer does not follow a weak actuator."""
        assumed, law, eta, h = self.assumed, self.law, self.assumed.eta, self.law.h
        x = law.kappa * h * (1 - law.ell) / law.ell  # κ λ_o
        weak = 1 - 2 * (1 - eta) * x
        late = 1 - 2 * law.kappa * h * assumed.late
        if not (weak > 0 and late > 0):
            return (self.arithmetic.number(float("inf")),) * 3
        factor = observer_spread(eta, x, weak) / (law.kappa * late)

        def axis(i: int) -> Number:
            kick = self.body.row[i] * (h * self.V_rate)
            kick = kick + assumed.late * h * (assumed.max_torque + 5 * self._most_used[i])
            return self.D[i] * factor + kick

        return _triple(axis)

    def _uncompensated(self) -> Numbers:
        assumed, law, eta = self.assumed, self.law, self.assumed.eta

        def axis(i: int) -> Number:
            free = (1 - eta) * self._most_used[i] + assumed.d + self.variation[i]
            free = free + assumed.dead_band + self._misled + self._gyroscopic
            return law.d_max + law.kappa * self.noise[i] + self.torque_noise[i] + free / eta

        return _triple(axis)
