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
from dataclasses import dataclass

from ppc_attitude.science.controllers.brake import BLEND
from ppc_attitude.science.guarantee.arithmetic import Arithmetic, Number
from ppc_attitude.science.guarantee.assumptions import Assumptions, Law
from ppc_attitude.science.guarantee.body import Body, Numbers, body_of
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


@dataclass(frozen=True)
class Bounds:
    """Bounds in one arithmetic; triples are per body axis.

    Attributes
    ----------
    assumed, law : Assumptions, Law
        For which they are.
    arithmetic : Arithmetic
        In which they are.
    body : Body
        Bounds of the inertia.
    e_w : number
        Largest error of ω_e [rad/s], from those of rate and attitude.
    z : number
        Largest ‖Ĵ⁻¹y‖ in the tube [rad/s].
    a, a_most : number
        Least and largest deceleration of the brake, about whatever axis [rad/s²].
    a_rate : number
        Largest |a'| where it acts [rad/s³].
    V_rate : number
        Largest |V'| where the cap acts, with what its estimate may be wrong in a sample [rad/s²].
    load : triple
        What feedforward and brake need [N·m].
    reserve : number
        a_r: acceleration that is left for a ramp [rad/s²].
    brake : triple
        T for which the load would be all of B [N·m].
    variation, variation_at_stop : triple
        Change of F within a sample [N·m]: in the main phase, and while p > 0.
    noise : triple
        N_i [N·m·s].
    B, Y : triple
        Largest B [N·m] and least Y [N·m·s] that the proof admits.
    stop_load : number
        Acceleration [rad/s²] that the turning axis needs while p > 0 in cruise.
    blend : number
        φ from which the cap alone acts, for the largest V [rad].
    nu_stop : number
        ν for every φ that a stop phase can see in cruise.
    """

    assumed: Assumptions
    law: Law
    arithmetic: Arithmetic
    body: Body
    e_w: Number
    z: Number
    a: Number
    a_most: Number
    a_rate: Number
    V_rate: Number
    load: Numbers
    reserve: Number
    brake: Numbers
    variation: Numbers
    variation_at_stop: Numbers
    noise: Numbers
    B: Numbers
    Y: Numbers
    stop_load: Number
    blend: Number
    nu_stop: Number

    def feedforward(self, rate: Number) -> Numbers:
        """M_i [N·m] for ‖ω_s‖ ≤ rate [rad/s]."""
        return _feedforward(self.body, self.assumed, rate)

    def stop_time(self, rate: Number) -> Number | None:
        """T_p [s]: p is 0 after it if ‖ω_e‖ ≤ rate [rad/s] at the event; None if never."""
        number, law = self.arithmetic.number, self.law
        feedforward = self.feedforward(rate + number(self.assumed.W) + number(law.z_bar))
        cruises = bool(rate <= number(law.w_far))
        times = []
        for i in range(3):
            left = number(law.B[i]) - feedforward[i]
            if cruises:
                left = left - self.body.row[i] * self.stop_load
            if not left > 0:
                return None
            times.append(self.body.row[i] * rate / left)
        return self.arithmetic.largest(*times)

    def cruise_start(self) -> Number | None:
        """φ [rad] from which a cruise reaches its speed before it has to brake (C9), if any."""
        number, law, z = self.arithmetic.number, self.law, self.arithmetic.number(self.law.z_bar)
        time = self.stop_time(number(law.w_far))
        if time is None or not self.reserve > 0:
            return None
        fastest = number(law.Omega_e) + number(self.assumed.W)
        stopping = (number(law.w_far) + self.e_w + z) * (time + number(law.h))
        start = self.blend + stopping + number(self.assumed.e_A)
        return start + fastest * fastest / (2 * self.reserve) + z * fastest / self.reserve


def _feedforward(body: Body, assumed: Assumptions, rate: Number) -> Numbers:
    """M_i: ω_e × w_d = ω_s × w_d, so ‖M0‖ needs ‖ω_s‖ and the reference only."""
    W, W1 = map(body.arithmetic.number, (assumed.W, assumed.W1))
    pairs = zip(body.row, body.spread, strict=True)
    return tuple(row * (rate * W + W1) + spread * rate * rate for row, spread in pairs)


class _Maker:
    """One evaluation of all bounds: what they share."""

    def __init__(
        self, assumed: Assumptions, law: Law, arithmetic: Arithmetic, count: Cells
    ) -> None:
        number = arithmetic.number
        self.assumed, self.law, self.arithmetic, self.count = assumed, law, arithmetic, count
        self.body = body_of(assumed, arithmetic)
        self.h, self.k, self.kappa, self.z = map(number, (law.h, law.k, law.kappa, law.z_bar))
        self.late = number(assumed.late)
        self.W, self.W1, self.W2 = map(number, (assumed.W, assumed.W1, assumed.W2))
        self.Omega = number(assumed.Omega)
        self.e_A = number(assumed.e_A)
        self.e_w = number(assumed.e_W) + self.W * self.e_A  # error of ω_e
        self.Y = tuple(map(number, law.Y))
        self.B = tuple(map(number, law.B))
        self.most_used = self.triple(lambda i: arithmetic.largest(self.B[i], number(law.B_ramp)))
        self.brake = tuple(map(number, law.brake))
        brakes = self.body.brakes(self.brake, number(law.a_most))
        reference = self.W, self.W1, self.W2
        self.speed = Speed(self.k, *brakes, number(law.Omega_e), *reference, self.z, arithmetic)
        self.stop_rate = number(law.omega0) + self.z  # ‖ω_e‖ while p > 0
        self.cruise_rate = number(law.w_far) + 2 * self.z  # the axis turns meanwhile: C9 n
        e_S = number(assumed.e_S)
        self.epsilon = self.body.inverse_error(e_S)
        spread = ((1 + e_S) * self.body.most - (1 - e_S) * self.body.least) / 2
        fastest = arithmetic.largest(self.Omega, self.stop_rate + self.W)
        self.gyroscopic = (self.epsilon * spread + e_S * self.body.most) * fastest * fastest

    def triple(self, function: Callable[[int], Number]) -> Numbers:
        """Value of a function of the axis for each axis."""
        return tuple(map(function, range(3)))

    def acceleration(self, rate: Number, variation: Numbers) -> Number:
        """A ≥ ‖ω_e'‖: v' from the most that |F| may be, and |y'| ≤ 2κY + δF."""
        feedforward = _feedforward(self.body, self.assumed, rate)
        commanded = self.triple(lambda i: self.most_used[i] + feedforward[i])
        tube = self.triple(lambda i: 2 * self.kappa * self.Y[i] + variation[i])
        return self.body.box(commanded) + self.body.box(tube)

    def feedforward_rate(self, i: int, w: Number, total: Number, acceleration: Number) -> Number:
        """Bound of |M0_i'| where ‖ω_e‖ ≤ w and ‖ω_s‖ ≤ total."""
        W, W1 = self.W, self.W1
        row, spread = self.body.row[i], self.body.spread[i]
        own = acceleration * W + w * (W1 + w * W) + self.W2 + w * W1
        return row * own + 2 * spread * total * (acceleration + W1 + w * W)

    def main_cells(self) -> list[Cell]:
        """Cells from the least V: a σ that follows V may lag by what V moves in two samples."""
        slowest = self.speed.Omega_e - self.W - 2 * self.h * self.arithmetic.number(self.law.V_rate)
        lowest, _ = self.arithmetic.outward(slowest)
        if lowest <= 0.0:
            raise ValueError(f"Omega_e = {self.law.Omega_e:g} rad/s leaves no speed beyond W")
        return cells(self.speed, lowest, self.e_A, self.e_w, self.count)

    def main_variation(self, found: list[Cell], A: Number, nu_blend: Number) -> Numbers:
        """δF in the main phase, with the ramps of r and σ."""
        most = self.arithmetic.largest
        part = self.arithmetic.number(0.5) + self.late
        sigma = 2 * A * nu_blend * self.z  # of σ' n', |σ'| ≤ ‖v'‖ ≤ A

        def axis(i: int) -> Number:
            row = self.body.row[i]
            return (
                part
                * self.h
                * most(
                    *(
                        row * (each.second + each.lever * A + 2 * self.k * each.ramp + sigma)
                        + self.feedforward_rate(i, each.speed, self.Omega, A)
                        for each in found
                    )
                )
            )

        return self.triple(axis)

    def stop_variation(self, A: Number, nu: Number, cotangent: Number) -> Numbers:
        """δF while p > 0: v' = p' ω_res, in cruise with σ n' besides."""
        part = self.arithmetic.number(0.5) + self.late
        fast, total = self.stop_rate, self.stop_rate + self.W
        slow = self.cruise_rate
        turning = slow * axis_second(nu, cotangent, slow, slow, A)

        def axis(i: int) -> Number:
            near = self.feedforward_rate(i, fast, total, A)
            cruise = self.feedforward_rate(i, slow, slow + self.W, A) + self.body.row[i] * turning
            return part * self.h * self.arithmetic.largest(near, cruise)

        return self.triple(axis)

    def torque_noise(self, found: list[Cell], nu: Number, cotangent: Number) -> Numbers:
        """N_F,i: change of F with the estimation errors, in any phase."""
        total = self.arithmetic.largest(self.Omega, self.stop_rate + self.W)
        e_W = self.arithmetic.number(self.assumed.e_W)
        slow = self.cruise_rate
        turning = slow * axis_error(nu, cotangent, slow, slow + self.e_w, self.e_A, self.e_w)
        of_v = self.arithmetic.largest(turning, *(each.error for each in found))
        of_m = self.W * e_W + (total * self.W + self.W1) * self.e_A

        def axis(i: int) -> Number:
            gyroscopic = self.body.spread[i] * e_W * (2 * total + e_W)
            return self.body.row[i] * (of_v + of_m) + gyroscopic

        return self.triple(axis)

    def allowed(self, variation: Numbers, noise: Numbers) -> Numbers:
        """Largest B: a saturated axis is still pushed back."""
        number, assumed = self.arithmetic.number, self.assumed
        torque, d = number(assumed.max_torque), number(assumed.d)
        root3 = self.arithmetic.sqrt(number(3.0))
        common = number(assumed.eta) * torque - d - number(assumed.dead_band)
        common = common - self.epsilon * root3 * (torque + d) - self.gyroscopic
        return self.triple(lambda i: common - variation[i] - noise[i])

    def tube(
        self, variation: Numbers, noise: Numbers, noise_of_torque: Numbers, jump: Number
    ) -> Numbers:
        """Least Y: D/κ_eff + kick; infinite if the observer does not follow a weak actuator."""
        number, assumed, law = self.arithmetic.number, self.assumed, self.law
        torque, d, eta = number(assumed.max_torque), number(assumed.d), number(assumed.eta)
        root3 = self.arithmetic.sqrt(number(3.0))
        ell = number(law.ell)
        x = self.kappa * self.h * (1 - ell) / ell  # κ λ_o
        weak = 1 - 2 * (1 - eta) * x
        late = 1 - 2 * self.kappa * self.h * self.late
        if not (weak > 0 and late > 0):
            return (number(float("inf")),) * 3
        factor = (1 + x / weak) / (self.kappa * late)

        def axis(i: int) -> Number:
            free = (1 - eta) * self.most_used[i] + d + variation[i] + number(assumed.dead_band)
            free = free + self.epsilon * root3 * (torque + d) + self.gyroscopic
            D = number(law.d_max) + self.kappa * noise[i] + noise_of_torque[i] + free / eta
            kick = self.body.row[i] * jump
            kick = kick + self.late * self.h * (torque + 5 * self.most_used[i])
            return D * factor + kick

        return self.triple(axis)


def bounds_of(
    assumed: Assumptions, law: Law, arithmetic: Arithmetic, count: Cells = FINE
) -> Bounds:
    """Evaluate every bound of the proof.

    Raises
    ------
    ValueError
        Ω_e leaves no speed beyond the reference's.
    """
    make = _Maker(assumed, law, arithmetic, count)
    number, most, body, speed = arithmetic.number, arithmetic.largest, make.body, make.speed
    c = number(BLEND)
    fast, slow = speed.Omega_e + make.W, speed.Omega_e - make.W
    end = arithmetic.pi + LARGEST

    def reached(g: Number, a: Number) -> Number:
        """φ at which the brake allows g ≥ a/k: less for a stronger one."""
        return g * g / (2 * a) + a / (2 * speed.k * speed.k)

    # The cap can act only beyond this φ; Φ's own step may look a little nearer.
    margin = 2 * make.h * (fast + make.stop_rate)
    nearest = reached((1 - c) * slow, speed.a_most) - margin
    nu_cap = nu_of(nearest, arithmetic) if nearest > 0 else number(float("inf"))
    blend = reached((1 + c) * fast, speed.a)
    # f depends on a beyond φ1 only, and φ rises by no more than h z̄ in a sample.
    linear = speed.a / (speed.k * speed.k) - make.h * make.z
    nu_brake = nu_of(linear, arithmetic) if linear > 0 else number(float("inf"))
    far = number(law.far)
    nu_blend = most(nu_of(blend, arithmetic), nu_of(end, arithmetic))
    nu_stop = most(nu_of(far / 2, arithmetic), nu_of(end, arithmetic))
    cotangent = most(half_cotangent(far / 2, arithmetic), half_cotangent(end, arithmetic))

    found = make.main_cells()
    guess: Numbers = (number(0.0),) * 3
    for _ in range(2):  # δF stands in A: twice from below, then it must be a fixed point
        guess = make.main_variation(found, make.acceleration(make.Omega, guess), nu_blend)
    # A δF that reproduces less than itself bounds the true one.
    inflated = make.triple(lambda i: guess[i] * number(1.002))
    variation = make.main_variation(found, make.acceleration(make.Omega, inflated), nu_blend)
    if not all(bool(v <= w) for v, w in zip(variation, inflated, strict=True)):
        raise ValueError("the variation of F within a sample has no bound: the gains are too high")
    variation = inflated
    A_stop = make.acceleration(make.stop_rate + make.W, variation)
    at_stop = make.stop_variation(A_stop, nu_stop, cotangent)
    noise_of_torque = make.torque_noise(found, nu_stop, cotangent)
    lipschitz = most(*(each.lipschitz for each in found))
    noise = make.triple(lambda i: body.row[i] * (make.e_w + lipschitz * make.e_A))
    feedforward = _feedforward(body, assumed, make.Omega)
    B = make.B
    free = arithmetic.least(*((B[i] - feedforward[i]) / body.row[i] for i in range(3)))
    needed = make.triple(
        lambda i: most(*(each.needed(body.row[i], make.brake[i], arithmetic) for each in found))
    )
    drift = most(*(arithmetic.sqrt(each.drift**2 + each.turn**2) for each in found))
    V_rate = speed.rate(nu_cap) + speed.gain * make.W * nu_cap * make.e_A / make.h
    a_rate = speed.brake_rate(speed.a_most, nu_brake * (make.z + make.e_A / make.h))
    w_far = number(law.w_far)
    return Bounds(
        assumed=assumed,
        law=law,
        arithmetic=arithmetic,
        body=body,
        e_w=make.e_w,
        z=body.box(make.Y),
        a=speed.a,
        a_most=speed.a_most,
        a_rate=a_rate,
        V_rate=V_rate,
        load=make.triple(lambda i: feedforward[i] + needed[i]),
        reserve=free - drift,
        brake=make.triple(lambda i: B[i] - feedforward[i] - (needed[i] - make.brake[i])),
        variation=variation,
        variation_at_stop=at_stop,
        noise=noise,
        B=make.allowed(variation, noise_of_torque),
        Y=make.tube(variation, noise, noise_of_torque, make.h * V_rate),
        stop_load=nu_stop * (w_far * w_far / 2 + w_far * make.z),
        blend=blend,
        nu_stop=nu_stop,
    )
