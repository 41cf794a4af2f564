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

"""No motion of the error that is drawn at random passes what the certificate bounds it by."""

import math
from typing import Any

import numpy as np
import pytest
from craft_helpers import case, guaranteed
from scipy.spatial.transform import Rotation
from test_closed_loop import POWERS, factor

from ppc_attitude.command_line import guarantee_view
from ppc_attitude.contract.topics import CONTROLLER
from ppc_attitude.science.controllers.brake import axis_rate, capped_brake, deceleration
from ppc_attitude.science.controllers.tube_parameters import PARAMETERS
from ppc_attitude.science.guarantee import known_reference
from ppc_attitude.science.guarantee.arithmetic import FLOATS
from ppc_attitude.science.guarantee.assumptions import Assumptions, Law, assumptions_of, law_of
from ppc_attitude.science.guarantee.body import Body
from ppc_attitude.science.guarantee.bounds import Bounds
from ppc_attitude.science.guarantee.cells import FINE, Speed, cells


@pytest.mark.parametrize("states", [1000, pytest.param(4000, marks=pytest.mark.long)])
def test_no_random_state_needs_more_than_the_load(states: int) -> None:
    """Torque M0 − J v' of random states, by differences along their own motion, against C3's."""
    assumed, law = guaranteed()
    bounds = Bounds(assumed, law, FLOATS)
    J = np.array(assumed.inertia).reshape(3, 3)
    random = np.random.default_rng(3)
    largest = np.zeros(3)
    for _ in range(states):
        largest = np.maximum(largest, np.abs(_torque(assumed, law, J, random)))
    share = largest / np.array(bounds.load)
    assert (share <= 1.0).all()
    assert share.max() > 0.8, "the bound is near what states need"


def _unit(random: np.random.Generator) -> Any:
    vector = random.normal(size=3)
    return vector / np.linalg.norm(vector)


def _speed_of(law: Law, J: Any, n: Any, phi: float, rate_d: Any) -> float:
    """f(φ; V, a) of the law, with V and a of the axis n."""
    b = float(n @ rate_d)
    cap = b + math.sqrt(b * b + law.Omega_e**2 - rate_d @ rate_d)
    a, _ = deceleration(tuple(n), (0.0,) * 3, tuple(map(tuple, J)), law.brake, law.a_most)
    return float(capped_brake(phi, law.k, a, cap)[0])


def _torque(assumed: Assumptions, law: Law, J: Any, random: np.random.Generator) -> Any:
    """F = M0 − J v' of a state in the main phase, v' by central differences."""
    phi = math.exp(random.uniform(math.log(1e-3), math.log(math.pi + 1)))
    n, z = _unit(random), law.z_bar * _unit(random)
    rate_d = assumed.W * random.uniform(0.5, 1.0) * _unit(random)
    acceleration_d = assumed.W1 * _unit(random)
    f = _speed_of(law, J, n, phi, rate_d)
    omega = -f * n + z
    n_rate = np.array(axis_rate(tuple(n), phi, tuple(omega))) / (2 * math.sin(phi / 2))

    def command(t: float) -> Any:
        axis = n + t * n_rate
        axis /= np.linalg.norm(axis)
        angle = phi + t * (n @ omega)
        return -_speed_of(law, J, axis, angle, rate_d + t * acceleration_d) * axis

    v_rate = (command(1e-5) - command(-1e-5)) / 2e-5
    # In the desired frame turned by φ about n the numbers of w_d are those of C_e ω_d.
    half = phi / 2
    q, q0 = math.sin(half) * n, math.cos(half)

    def to_body(a: Any) -> Any:
        return (q0 * q0 - q @ q) * a + 2 * (q @ a) * q - 2 * q0 * np.cross(q, a)

    w_d = to_body(rate_d)
    omega_s = omega + w_d
    m_0 = J @ (np.cross(omega, w_d) - to_body(acceleration_d)) - np.cross(omega_s, J @ omega_s)
    assert np.linalg.norm(omega_s) <= assumed.Omega
    return m_0 - J @ v_rate


@pytest.mark.parametrize("motions", [1000, pytest.param(3000, marks=pytest.mark.long)])
def test_no_random_motion_bends_more_than_its_bound(motions: int) -> None:
    """‖v''‖ along random motions of the error, by differences, against that of C1's δF."""
    assumed, law = guaranteed()
    J, A = np.array(assumed.inertia).reshape(3, 3), 0.05
    least, most = Body(assumed, FLOATS).brakes(law.brake, law.a_most)
    rates = (law.Omega_e, assumed.W, assumed.W1, assumed.W2, law.z_bar)
    speed = Speed(law.k, least, most, *rates, 0.0, 0.0, FLOATS)
    found = cells(speed, law.Omega_e - assumed.W, FINE)
    bound = max(each.second + each.lever * A for each in found)
    random = np.random.default_rng(4)
    largest = 0.0
    for _ in range(motions):
        phi = math.exp(random.uniform(math.log(5e-3), math.log(math.pi + 0.9)))
        n, z = _unit(random), law.z_bar * _unit(random)
        rate_d = assumed.W * random.uniform(0.5, 1.0) * _unit(random)
        motion = (rate_d, assumed.W1 * _unit(random), assumed.W2 * _unit(random))
        omega = z - _speed_of(law, J, n, phi, rate_d) * n
        second = _bending(law, J, phi * n, (omega, A * _unit(random)), motion)
        largest = max(largest, float(np.linalg.norm(second)))
    assert largest <= bound
    assert largest > 0.4 * bound, "the bound is near what motions need"


def _bending(law: Law, J: Any, turn: Any, omega: tuple[Any, Any], motion: tuple[Any, ...]) -> Any:
    """v'' where ω_e and ω_e' carry an error, with ω_d, ω_d' and ω_d'', by central differences."""
    h, start = 1e-3, Rotation.from_rotvec(turn)

    def command(t: float) -> Any:
        turned = start * Rotation.from_rotvec(t * omega[0] + t * t / 2 * omega[1])
        angle = turned.magnitude()
        axis = turned.as_rotvec() / angle
        if axis @ turn < 0.0:  # beyond half a turn
            axis, angle = -axis, 2 * math.pi - angle
        rate_d = motion[0] + t * motion[1] + t * t / 2 * motion[2]
        return -_speed_of(law, J, axis, angle, rate_d) * axis

    return (command(h) - 2 * command(0.0) + command(-h)) / h**2


def test_a_known_reference_is_followed_until_a_slow_craft_has_settled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """After 400 s, as many steps, the bound gave up; here each rate is a sixteenth."""
    monkeypatch.setattr(known_reference, "_FACES", (6,))
    monkeypatch.setattr(known_reference, "_STEPS", 500)
    values = dict(case("guaranteed").parameters[CONTROLLER])
    times = []
    for slower in (1.0, 16.0):
        for each in PARAMETERS:
            if each.unit in POWERS:
                scale = factor(each.unit, 1.0, slower)
                values[each.name] = np.multiply(scale, values[each.name]).tolist()
        bound = known_reference.KnownReference(
            assumptions_of(values), law_of(values), lambda t: np.zeros((t.size, 3)), np.zeros(3)
        )
        times.append(bound.time(0.0, 5e-3))
    assert times[1] == pytest.approx(16.0 * times[0], rel=1e-3)


def test_cells_that_settle_late_are_divided_and_lose_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(guarantee_view, "balls", lambda: FLOATS)
    monkeypatch.setattr(guarantee_view, "RATES", ())
    judged = guarantee_view.Judgement(case("guaranteed_ahead"), [])
    times = []
    for faces in ((12,), (6, 12), (6,)):
        monkeypatch.setattr(known_reference, "_FACES", faces)
        (told,) = judged.of_reference([0.0])
        times.append(float(told.partition("from t = ")[2].partition(" s on, for every")[0]))
    fine, divided, coarse = times
    assert fine <= divided < coarse < 101.97  # of any reference
