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

"""The law against its equations, written out here in matrices, as corrected."""

import math
from typing import Any

import numpy as np
import pytest
from craft_helpers import configs
from hypothesis import given
from hypothesis import strategies as st
from record_helpers import Array, derivative, f_matrix, inputs_of, outputs_of, records_of, state_of
from scipy.spatial.transform import Rotation
from test_virtual_control import paper_virtual_control

from ppc_attitude.science.controllers import ppc
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kernel import ZERO, Vector, matrix, vector
from ppc_attitude.science.parameter import resolved
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import load

FULL = [2.8, 0.15, -0.1, 0.15, 2.5, 0.2, -0.1, 0.2, 1.9]
seeds = st.integers(0, 2**32 - 1)


def configured(**values: Any) -> Any:
    return ppc.configure(resolved(ppc.PARAMETERS, values, "ppc_controller"))


def drive_of(memory: Any, gains: Any) -> Any:
    """What the saturation that a memory holds drives."""
    return ppc.saturation_drive(vector(memory["delta_tau"]), matrix(gains["inertia_inverse"]))


def random_situation(seed: int) -> tuple[Any, Any]:
    """A measurement in mid-run, and a memory as after a saturated sample at the same instant."""
    rng = np.random.default_rng(seed)
    measurement, memory = inputs_of(ppc.COMPONENT), state_of(ppc.COMPONENT)
    measurement["t"] = rng.uniform(0.0, 100.0)
    desired = Rotation.random(random_state=rng)
    error = Rotation.from_rotvec(rng.normal(size=3) * 0.2)
    measurement["attitude"] = (desired * error).as_quat()
    measurement["reference_attitude"] = desired.as_quat()
    for name, scale in (
        ("angular_velocity", 0.03),
        ("reference_angular_velocity", 0.01),
        ("reference_angular_acceleration", 1e-3),
    ):
        measurement[name] = scale * rng.normal(size=3)
    memory["started"], memory["t"] = 1.0, measurement["t"]
    memory["plan"]["stretch"] = 1.0
    memory["delta_tau"] = 0.02 * rng.normal(size=3)
    memory["delta_rho_q"] = rng.uniform(0.0, 0.02, 3)
    memory["delta_rho_omega"] = rng.uniform(1e-3, 0.05, 3)
    memory["theta"] = 0.1 * rng.normal(size=3)
    return measurement, memory


def nominal_part(prefix: str, t: float) -> tuple[float, float]:
    """ρ_n and ρ_n' of Tables I and II, from the constants of the spec."""
    if prefix == "attitude":
        top, asymptote, decay, t1, t2, a1, end = (
            *(1.0, 1e-4, 0.05),
            *(20.547627909862406, 60.0, 2.26797041865e-4, 5e-3),
        )
    else:
        a1 = 0.5 * (0.08 - 3e-5) * math.exp(-18.0) * 0.5 / 4.0
        top, asymptote, decay, t1, t2, end = 0.08, 3e-5, 0.5, 36.0, 40.0, 3e-5
    if t < t1:
        part = (top - asymptote) * math.exp(-decay * t)
        return part + asymptote, -decay * part
    if t < t2:
        return a1 * (t - t2) ** 2 + end, 2.0 * a1 * (t - t2)
    return end, 0.0


def unsaturated_torque(m: Any, memory: Any, gains: Any, norm_form: bool) -> dict[str, Array]:
    """u of eq. 20, corrected, with v' as a central difference along the motion."""
    inertia = np.array(gains["inertia"])
    inverse = np.linalg.inv(inertia)
    error = Rotation.from_quat(m["reference_attitude"]).inv() * Rotation.from_quat(m["attitude"])
    to_body = error.inv().as_matrix()
    omega = np.array(m["angular_velocity"])
    omega_d = to_body @ m["reference_angular_velocity"]
    omega_e = omega - omega_d
    m_0 = (
        inertia @ np.cross(omega_e, omega_d)
        - inertia @ to_body @ m["reference_angular_acceleration"]
        - np.cross(omega, inertia @ omega)
    )
    delta_q, delta_omega = np.array(memory["delta_rho_q"]), np.array(memory["delta_rho_omega"])
    rho_omega_0, slope_omega = nominal_part("rate", m["t"])
    rho_q_0, slope_q = nominal_part("attitude", m["t"])
    rho_omega = rho_omega_0 + delta_omega
    drive = np.abs(inverse) @ np.abs(np.tanh(memory["delta_tau"])) / rho_omega
    rho_omega_rate = slope_omega - gains["C_omega"] * delta_omega + gains["B_tau"] * drive
    rho_q = rho_q_0 + delta_q
    rho_q_rate = slope_q - gains["C_q"] * delta_q + gains["C_tau"] * drive
    rho_q_rate = np.where(rho_q > 1.0, 0.0, rho_q_rate)
    rho_q = np.minimum(rho_q, 1.0)
    start = error.as_quat()

    def v_at(t: float) -> Array:
        q_e = (error * Rotation.from_rotvec(t * omega_e)).as_quat()
        q_e *= math.copysign(1.0, float(q_e @ start))
        return paper_virtual_control(q_e, rho_q + t * rho_q_rate, gains["beta"], norm_form)

    z2 = omega_e - v_at(0.0)
    epsilon_q, epsilon_omega = start[:3] / rho_q, z2 / rho_omega
    argument = inverse @ (epsilon_omega / rho_omega) / (np.diag(inverse) / rho_omega)
    d_hat = gains["D_m"] * np.tanh(argument / gains["mu"])
    weight = (
        gains["k1"]
        * np.tanh(epsilon_q @ epsilon_q / gains["F1"])
        / (gains["k2"] * np.tanh(epsilon_omega @ epsilon_omega / gains["F2"]) + gains["sigma"])
    )
    u = (
        -m_0
        - d_hat
        + inertia @ derivative(v_at, 1e-3)
        - gains["K_omega"] * inertia @ z2
        + inertia @ (rho_omega_rate / rho_omega * z2)
        - gains["K_u"] * inertia @ (rho_omega * memory["theta"])
        - weight * inertia @ (rho_omega**2 * (f_matrix(start).T @ (epsilon_q / rho_q)))
    )
    return {"u": u, "q_e": start, "z2": z2, "rho_q": rho_q, "rho_omega": rho_omega}


@pytest.mark.parametrize("form", ["componentwise", "norm"])
@pytest.mark.parametrize("inertia", [FULL, ppc.INERTIA.default], ids=["full", "diagonal"])
@given(seed=seeds)
def test_step_is_the_corrected_law(form: str, inertia: list[float], seed: int) -> None:
    gains = configured(virtual_control=form, inertia=inertia, k1=1.3, k2=0.7, F1=1.2, F2=0.9)
    measurement, memory = random_situation(seed)
    expected = unsaturated_torque(measurement, memory, gains, form == "norm")
    command = outputs_of(ppc.COMPONENT)
    ppc.step(measurement, memory, gains, command)
    sign = np.sign(command["attitude_error"] @ expected["q_e"])
    assert np.allclose(command["attitude_error"], sign * expected["q_e"], atol=1e-14)
    assert np.allclose(command["rate_error"], expected["z2"], atol=1e-14)
    assert np.allclose(command["attitude_envelope"], expected["rho_q"], rtol=1e-9)
    assert np.allclose(command["rate_envelope"], expected["rho_omega"], rtol=1e-9)
    u = expected["u"]
    assert np.allclose(command["unsaturated_torque"], u, rtol=1e-6, atol=1e-8)
    assert np.allclose(command["torque_command"], np.clip(u, -0.05, 0.05), atol=1e-7)
    delta = np.clip(u, -0.05, 0.05) - u
    assert np.allclose(memory["delta_tau"], delta, rtol=1e-6, atol=2e-8)


def test_the_dead_band_is_not_a_saturation() -> None:
    """Counting what the actuator swallows below 1e-4 N·m would hold the envelopes open."""
    gains = configured()
    measurement, memory, command = records_of(ppc.COMPONENT)
    measurement["attitude"] = measurement["reference_attitude"] = (0.0, 0.0, 0.0, 1.0)
    measurement["angular_velocity"] = (1e-9, 0.0, 0.0)
    ppc.step(measurement, memory, gains, command)
    assert 0.0 < abs(command["torque_command"][0]) < 1e-4
    assert np.all(memory["delta_tau"] == 0.0)


def barrier_rates(seed: int, sigma: float) -> tuple[float, float]:
    """z2's part of V̇1, and what the cross term puts into V̇2, both from the definitions of V."""
    gains = configured(k1=1.7, k2=0.6, F1=0.8, F2=1.4)
    gains["sigma"] = sigma
    rng = np.random.default_rng(seed)
    q = rng.normal(size=3) * 0.2
    q0 = math.copysign(math.sqrt(1.0 - q @ q), rng.normal())
    rho_q, rho_omega = rng.uniform(0.1, 1.0, 3), rng.uniform(1e-3, 0.08, 3)
    z2 = rng.uniform(0.2, 1.5, 3) * rng.choice([-1, 1], 3) * rho_omega
    epsilon_q, epsilon_omega = q / rho_q, z2 / rho_omega
    f = f_matrix([*q, q0])
    gain_q = gains["k1"] * np.tanh(epsilon_q @ epsilon_q / gains["F1"])
    gain_omega = gains["k2"] * np.tanh(epsilon_omega @ epsilon_omega / gains["F2"])
    in_v1 = gain_q * (epsilon_q / rho_q) @ (f @ z2)
    vectors = (epsilon_q, epsilon_omega, rho_q, rho_omega, q)
    term = np.array(ppc.cross_term(*(tuple(x.tolist()) for x in vectors), q0, gains))
    # z2' contains −term, and V̇2 = k2 tanh(|ε_ω|²/F2) ε_ωᵀ ε_ω'.
    return float(in_v1), float(-gain_omega * (epsilon_omega / rho_omega) @ term)


@given(seeds)
def test_cross_terms_cancel_and_sigma_only_weakens_that(seed: int) -> None:
    for sigma, low, high in ((0.0, -1.0 - 1e-9, -1.0 + 1e-9), (0.0113, -1.0, 0.0)):
        in_v1, in_v2 = barrier_rates(seed, sigma)
        assert low < in_v2 / in_v1 < high


def test_products_of_inertia_make_no_chatter() -> None:
    craft = {node: {"inertia": FULL} for node in ("spacecraft_plant", "ppc_controller")}
    record = simulate(load(configs("paper"), craft), 70.0)
    steps = np.diff(record["torque_command"][6000:], axis=0)
    assert np.sqrt(np.mean(steps**2)) < 1e-6  # [N·m]; 7e-3 with an estimate that only has a sign
    assert (np.abs(record["rate_error"]) < record["rate_envelope"]).all()


DELTA_TAU, XI, THETA = (0.01, -0.02, 0.005), (20.0, 30.0, 10.0), (0.3, -0.1, 0.2)


@pytest.mark.parametrize(
    ("theta", "delta_tau", "xi", "h"),
    [(THETA, DELTA_TAU, XI, 0.05), (ZERO, (10.0, -5.0, 3.0), (3e4, 3e4, 3e4), 0.02)],
)
def test_auxiliary_state_solves_its_implicit_equation_however_stiff(
    theta: Vector, delta_tau: Vector, xi: Vector, h: float
) -> None:
    """Eq. 21 with δ = 1e-3 added, so that θ = 0 divides nothing by zero."""
    gains = configured(inertia=FULL)
    inverse = np.linalg.inv(np.reshape(FULL, (3, 3)))
    pull = np.array(xi) * (inverse @ delta_tau)
    decay = gains["K_a"] + gains["K_b"] * (pull @ pull) / (np.dot(theta, theta) + 1e-6)
    after = np.array(ppc.auxiliary_step(theta, delta_tau, xi, matrix(inverse), gains, h))
    pushed = theta + h * np.array(xi) * (inverse @ np.tanh(delta_tau))
    assert after * (1.0 + h * decay) == pytest.approx(pushed, rel=1e-12, abs=0.0)


def test_saturation_opens_every_axis_that_it_couples_to() -> None:
    inverse = np.linalg.inv(np.reshape(FULL, (3, 3)))
    expected = np.abs(inverse) @ np.abs(np.tanh(DELTA_TAU))
    drive = ppc.saturation_drive(DELTA_TAU, matrix(inverse))
    assert np.allclose(drive, expected, rtol=1e-12)
    gains, memory = configured(inertia=FULL), state_of(ppc.COMPONENT)
    memory["delta_tau"] = DELTA_TAU
    ppc.integrate(memory, gains, drive, 0.01, 1e-9)  # so short that nothing falls meanwhile
    for name, gain in (("delta_rho_omega", "B_tau"), ("delta_rho_q", "C_tau")):
        opened = 1e-9 * gains[gain] * expected / 0.01
        assert memory[name] == pytest.approx(opened, rel=1e-5, abs=0.0)


def test_without_widening_the_envelopes_are_the_tables() -> None:
    gains = configured(adaptive_envelope=False)
    memory = state_of(ppc.COMPONENT)
    memory["delta_tau"] = (1.0, -1.0, 1.0)
    drive = drive_of(memory, gains)
    ppc.integrate(memory, gains, drive, 0.01, 0.01)
    rho_q, rho_q_rate, rho_omega, rho_omega_rate = ppc.composite_envelopes(
        memory, gains, drive, (0.5, -0.01), (0.01, -0.002)
    )
    assert rho_q == (0.5, 0.5, 0.5)
    assert rho_q_rate == (-0.01, -0.01, -0.01)
    assert rho_omega == (0.01, 0.01, 0.01)
    assert rho_omega_rate == (-0.002, -0.002, -0.002)
    assert np.any(memory["theta"] != 0.0)  # the auxiliary system works all the same


def test_envelopes_close_after_widening_is_switched_off() -> None:
    """They stayed as wide as they were for ever, while their rates said that they close."""
    gains, memory = configured(adaptive_envelope=False), state_of(ppc.COMPONENT)
    memory["delta_rho_q"], memory["delta_rho_omega"] = 0.1, 0.02
    memory["delta_tau"] = (1.0, -1.0, 1.0)
    for _ in range(1000):
        ppc.integrate(memory, gains, drive_of(memory, gains), 0.01, 0.01)
    assert memory["delta_rho_q"] == pytest.approx(0.1 * math.exp(-10.0 * gains["C_q"]), rel=0.06)
    closed = 0.02 * math.exp(-10.0 * gains["C_omega"])
    assert memory["delta_rho_omega"] == pytest.approx(closed, rel=0.06)


def test_attitude_envelope_never_passes_one() -> None:
    """Nor does it change above: as it closed there, v' was said to be what it was not."""
    gains, memory = configured(adaptive_envelope=False), state_of(ppc.COMPONENT)
    memory["delta_rho_q"] = (0.5, 0.05, 0.0)
    memory["delta_tau"] = (1.0, 1.0, 1.0)
    rho_q, rho_q_rate, _, _ = ppc.composite_envelopes(
        memory, gains, drive_of(memory, gains), (0.9, -0.1), (3e-5, 0.0)
    )
    assert rho_q == (1.0, pytest.approx(0.95), pytest.approx(0.9))
    assert rho_q_rate[0] == 0.0 > rho_q_rate[1]
    assert not ppc.is_outside((1.0, 0.94, -0.89), rho_q)
    for axis, sign in np.ndindex(3, 2):
        q = (-1.0) ** sign * np.eye(3)[axis]
        assert not ppc.is_outside(tuple(0.99 * (0.9 - 0.1 * axis) * q), (0.9, 0.8, 0.7))
        assert ppc.is_outside(tuple(1.01 * (0.9 - 0.1 * axis) * q), (0.9, 0.8, 0.7))


@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3), st.floats(0.1, 5.0), st.floats(0.1, 5.0))
def test_the_gain_is_that_of_the_barriers_derivative(epsilon: Any, k: float, F: float) -> None:
    gain = ppc.barrier_gain(epsilon, k, F)
    assert 0.0 <= gain <= k
    for i, axis in enumerate(np.eye(3)):

        def barrier(step: float, axis: Array = axis) -> Any:  # V_B = (k/2) F ln cosh(εᵀε/F)
            x = epsilon + step * axis
            return 0.5 * k * F * np.log(np.cosh(x @ x / F))

        assert gain * epsilon[i] == pytest.approx(derivative(barrier, 1e-4), rel=1e-6, abs=1e-7)


def test_the_gain_stays_finite_far_outside() -> None:
    assert ppc.barrier_gain((1e150, 0.0, 0.0), 2.0, 0.1) == 2.0


@pytest.mark.parametrize("prefix", ["attitude_envelope", "rate_envelope"])
def test_the_smallest_envelope_gives_numbers_and_a_smaller_one_is_refused(prefix: str) -> None:
    def paper(terminal: float) -> Any:
        ends = dict.fromkeys(("exponential_terminal", "terminal"), terminal) | {"initial": 1e-29}
        given = {f"{prefix}.{name}": value for name, value in ends.items()}
        return load(configs("paper")).with_values("ppc_controller", **given)

    assert np.isfinite(simulate(paper(1e-30), 0.5)["torque_command"]).all()
    with pytest.raises(ConfigurationError, match=r"terminal = 1e-160.*; allowed: finite, ≥ 1e-30"):
        paper(1e-160)


def test_the_smallest_sigma_keeps_the_cross_term_a_number_however_small_the_weight_is() -> None:
    def paper(sigma: float) -> Any:
        return load(configs("paper")).with_values("ppc_controller", sigma=sigma, k2=5e-324)

    assert np.isfinite(simulate(paper(1e-30), 0.5)["torque_command"]).all()
    with pytest.raises(ConfigurationError, match=r"sigma = 5e-324; allowed: finite, ≥ 1e-30"):
        paper(5e-324)
