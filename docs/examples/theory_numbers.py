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

"""Print the numbers of docs/theory.md that no command of ppc_attitude prints.

python docs/examples/theory_numbers.py
python docs/examples/theory_numbers.py --starts 1000
"""

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np

from ppc_attitude.command_line.proportions import actuator_torques
from ppc_attitude.contract.topics import CONTROLLER, INJECTOR, PLANT
from ppc_attitude.science.attitude import (
    jacobian,
    jacobian_inverse_scaled,
    jacobian_transposed,
    product,
)
from ppc_attitude.science.controllers.common import ATTITUDE_TABLE, RATE_TABLE
from ppc_attitude.science.environments.paper import environment_torque
from ppc_attitude.science.kernel import quaternion, vector
from ppc_attitude.science.performance import nominal, solve_envelope
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.loop_margin import loop_margin
from ppc_attitude.simulation.scenario import Scenario, load

CONFIG = Path(__file__).parents[2] / "config"
J = np.array([2.8, 2.5, 1.9])
SETTLED = 5e-3
HIT = {"pulse_times": [80.0], "pulse_durations": [0.1], "pulse_torques": [0.8] * 3}


def show(name: str, value: Any, unit: str = "") -> None:
    """Print one number as the page has it."""
    print(f"{name:<58} {value:.4g} {unit}".rstrip())


def errors_of(record: Any) -> Any:
    """Largest |q_ev| component at every instant."""
    return np.abs(record["attitude_error"][:, :3]).max(axis=1)


def last_unsettled(t: Any, error: Any) -> float:
    """Last instant [s] at which the error is 5e-3 or more."""
    return float(t[error >= SETTLED].max(initial=0.0))


def task(paper: Scenario) -> None:
    """Reference, environment and initial error."""
    start = simulate(paper, 120.0)
    rates = np.degrees(np.linalg.norm(start["reference_angular_velocity"], axis=1))
    show("largest |omega_d| in 120 s", rates.max(), "deg/s")
    torques = [np.linalg.norm(environment_torque(t)) for t in np.arange(0.0, 700.0, 0.1).tolist()]
    show("largest |d| of the environment, a whole period", max(torques), "N·m")
    q_e = start["attitude_error"][0].tolist()
    print("initial error q_e", " ".join(f"{each:.5f}" for each in q_e))
    show("initial error angle", math.degrees(2.0 * math.acos(abs(q_e[3]))), "deg")


def envelopes() -> None:
    """Joints and steepest relative fall of the two tables."""
    for name, table in (("Table I", ATTITUDE_TABLE), ("Table II repaired", RATE_TABLE)):
        shape = solve_envelope(name, table)
        times = np.linspace(0.0, table.settling_time, 200_001)
        fall = np.array([-rate / value for value, rate in (nominal(t, shape) for t in times)])
        show(f"{name}: r", shape["r"])
        print(f"{name + ': t1':<58} {shape['t1']:.9f} s")
        print(f"{name + ': a1':<58} {shape['curvature']:.11e}")
        show(f"{name}: largest -rho'/rho", fall.max(), "1/s")
        show(f"{name}: at", times[fall.argmax()], "s")


def rate_bounds() -> None:
    """Largest |v|/(k M_omega max rho) of the componentwise form, beta -> infinity."""
    random = np.random.default_rng(1)
    quaternions = random.normal(size=(200_000, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1)[:, None]
    speeds = np.array(
        [jacobian_inverse_scaled(tuple(q[:3]), q[3], tuple(np.sign(q[:3]))) for q in quaternions]
    )
    show("largest |v| / (k M_omega rho), 200000 attitudes", np.linalg.norm(speeds, axis=1).max())
    show("largest |v_i| / (k M_omega rho)", np.abs(speeds).max())


def cross_term_ratio() -> None:
    """Cross term of V2' over the z2 term of V1' (to cancel: -1), sigma = 0, random states."""
    random = np.random.default_rng(2)
    k1, k2 = 2.0, 0.7
    corrected, printed = [], []
    for _ in range(1000):
        q_e = random.normal(size=4)
        q_e /= np.linalg.norm(q_e)
        q, q0 = vector(q_e), float(q_e[3])
        rho_q, rho_w, z2 = random.uniform(0.1, 1.0, (3, 3))
        eps_q, eps_w = np.array(q) / rho_q, z2 / rho_w
        gain_q, gain_w = math.tanh(eps_q @ eps_q), k2 * math.tanh(eps_w @ eps_w)
        target = k1 * gain_q * (eps_q / rho_q) @ np.asarray(jacobian(q, q0, vector(z2)), float)
        right = rho_w**2 * np.asarray(jacobian_transposed(q, q0, vector(eps_q / rho_q)), float)
        wrong = rho_w**2 / rho_q * np.asarray(jacobian(q, q0, vector(eps_q)), float)
        corrected.append(-gain_w * (eps_w / rho_w) @ right * k1 * gain_q / gain_w / target)
        printed.append(-gain_w * (eps_w / rho_w) @ wrong * gain_q / gain_w / target)
    show("cross term ratio as implemented: smallest", min(corrected))
    show("cross term ratio as implemented: largest", max(corrected))
    show("cross term ratio as printed: lower tenth", np.percentile(printed, 10))
    show("cross term ratio as printed: upper tenth", np.percentile(printed, 90))


def follows_table(paper: Scenario, component: float, axis: int) -> bool:
    """True if a start with this component of q_ev on one axis keeps to Table I."""
    error = np.zeros(4)
    error[axis], error[3] = component, math.sqrt(1.0 - component**2)
    q_d = tuple(simulate(paper, 0.0)["reference_attitude"][0].tolist())
    start = product(q_d, quaternion(error))
    record = simulate(paper.with_values(PLANT, initial_attitude=list(start)), 120.0)
    return bool(np.all(np.abs(record["attitude_error"][:, :3]) < record["attitude_envelope"]))


def largest_start(paper: Scenario) -> None:
    """Bisect the largest component of q_ev on each axis from which the error follows Table I."""
    for axis, name in enumerate("xyz"):
        low, high = 0.1, 0.9
        while high - low > 1e-3:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if follows_table(paper, middle, axis) else (low, middle)
        show(f"largest initial |q_ev,{name}| that Table I admits", low)


def sample_times(paper: Scenario) -> None:
    """The normal case and the hit at 80 s at other rates, and with one sample of delay."""
    for rate in (50.0, 100.0, 200.0, 500.0, 1000.0):
        report(f"{rate:g} Hz", paper.with_values(PLANT, rate=rate))
    report("100 Hz, one sample of delay", paper.with_values(PLANT, late_command=True))
    report("norm form, beta 6", paper.with_values(CONTROLLER, virtual_control="norm", beta=6.0))


def margins(paper: Scenario) -> None:
    """Disk margin of the loop, alone and with overlays, and of the other laws."""
    loops = {"paper": paper}
    for overlay in ("flexible", "sensors_smallsat", "thrusters", "guaranteed"):
        loops[overlay] = load([CONFIG / "paper.yaml", CONFIG / f"{overlay}.yaml"])
    for law in ("log_barrier", "quaternion_feedback"):
        loops[law] = paper.with_values(CONTROLLER, controller=law)
    for name, loop in loops.items():
        found = loop_margin(loop, 60.0, actuator_torques(loop)[1])
        show(f"{name}: disk margin", found.disk)
        show(f"{name}: gain", found.gain)
        show(f"{name}: phase", found.phase, "deg")
        show(f"{name}: worst at", found.frequency, "Hz")


def saturated(paper: Scenario) -> None:
    """Torque of the law in saturation, in the second and in 0.3 s after the hit's begin."""
    for rate in (100.0, 400.0, 1600.0):
        struck = simulate(paper.with_values(PLANT, rate=rate).with_values(INJECTOR, **HIT), 81.0)
        largest = np.abs(struck["unsaturated_torque"][struck.t >= 80.0]).max()
        given = struck["applied_torque"][(struck.t >= 80.1) & (struck.t < 80.4)]
        show(f"{rate:g} Hz: largest |u|", largest, "N·m")
        show(f"{rate:g} Hz: mean of the applied torque", np.abs(given.mean(axis=0)).mean(), "N·m")


def report(name: str, scenario: Scenario) -> None:
    """Settling, terminal error, largest rate, and recovery from 0.8 N·m x 0.1 s at 80 s."""
    record = simulate(scenario, 120.0)
    struck = simulate(scenario.with_values(INJECTOR, **HIT), 120.0)
    t, error = record.t, errors_of(record)
    rate = np.degrees(np.linalg.norm(record["angular_velocity"], axis=1)).max()
    print(
        f"{name:<28} settled {last_unsettled(t, error):.2f} s, last 20 s "
        f"{error[t >= 100.0].max():.3g}, rate {rate:.3f} deg/s, recovery "
        f"{last_unsettled(t, errors_of(struck)) - 80.0:.2f} s"
    )


def hits() -> None:
    """What momentum and angle a pulse of 0.8 N·m on every axis leaves, and 0.05 N·m takes away."""
    print("hit [s]  rate left [deg/s]  stop after [s]  largest angle turned on an axis [deg]")
    for duration in (0.05, 0.1, 0.2, 0.5, 1.0):
        rate = np.degrees(np.linalg.norm(0.8 * duration / J))
        stop = 0.8 * duration / 0.05
        turned = np.degrees(0.5 * 0.8 * duration / J.min() * stop)
        print(f"{duration:<8g} {rate:<18.3g} {stop:<15.3g} {turned:.3g}")


def benchmark() -> None:
    """Where the logarithmic barrier settles after the hit at 80 s, predicted and simulated."""
    names = ("paper", "comparison_hit", "traditional")
    scenario = load([CONFIG / f"{name}.yaml" for name in names])
    gains = scenario.parameters[CONTROLLER]
    table = float(str(gains["attitude_envelope.terminal"]))
    k_b, K1, K2 = (float(str(gains[f"log_barrier.{name}"])) for name in ("k_b", "K1", "K2"))
    show("log_barrier: predicted q*", math.sqrt(table**2 + k_b / (4.0 * K1 * K2)))
    record = simulate(scenario, 600.0)
    for column, name in enumerate("xyz"):
        settled = np.abs(record["attitude_error"][record.t > 300.0, column])
        print(f"log_barrier: |q_ev,{name}| after 300 s: {settled.min():.4f} to {settled.max():.4f}")
    rates = np.degrees(np.linalg.norm(record["angular_velocity"], axis=1))
    show("log_barrier: largest rate in the first 80 s", rates[record.t < 80.0].max(), "deg/s")


def along_the_run(paper: Scenario) -> None:
    """How much of its envelope the normal case fills."""
    record = simulate(paper, 120.0)
    normalised = np.abs(record["attitude_error"][:, :3]) / record["attitude_envelope"]
    show("normal case: largest |eps_q|", normalised.max())
    show("normal case: at", record.t[normalised.max(axis=1).argmax()], "s")
    show("normal case: |eps_q| at t2 = 60 s", normalised[record.t >= 60.0].max())
    outer = np.abs(record["rate_error"]) / record["rate_envelope"]
    show("normal case: largest |eps_omega|", outer.max())
    saturated = record["torque_command"] != record["unsaturated_torque"]
    show("normal case: time with an axis saturated", saturated.any(axis=1).mean() * 120.0, "s")


def any_start(count: int) -> None:
    """Random starts, uniform on SO(3), rates up to 1 deg/s in any direction, 180 s each."""
    scenario = load([CONFIG / "paper.yaml", CONFIG / "any_start.yaml"])
    random = np.random.default_rng(3)
    settled, terminal, fastest, outside, angle = [], [], [], 0, 0.0
    for _ in range(count):
        attitude, direction = random.normal(size=4), random.normal(size=3)
        rate = math.radians(random.uniform(0.0, 1.0)) * direction / np.linalg.norm(direction)
        start = {
            "initial_attitude": (attitude / np.linalg.norm(attitude)).tolist(),
            "initial_angular_velocity": rate.tolist(),
        }
        record = simulate(scenario.with_values(PLANT, **start), 180.0)
        error, q = errors_of(record), record["attitude_error"]
        settled.append(last_unsettled(record.t, error))
        terminal.append(error[record.t >= 160.0].max())
        speed = np.linalg.norm(record["angular_velocity"], axis=1)
        fastest.append(np.degrees(speed.max()))
        outside += int(np.any(np.abs(q[:, :3]) > record["attitude_envelope"]))
        angle = max(angle, math.degrees(2.0 * math.acos(min(abs(q[0, 3]), 1.0))))
    print(f"any start: {count} starts, the largest error {angle:.2f} deg, {outside} outside")
    show("any start: latest settling", max(settled), "s")
    show("any start: median settling", float(np.median(settled)), "s")
    show("any start: largest error of the last 20 s", max(terminal))
    show("any start: largest rate", max(fastest), "deg/s")


def main() -> None:
    """Print all of them."""
    parser = argparse.ArgumentParser(description="Numbers of docs/theory.md.")
    parser.add_argument("--starts", type=int, default=0, help="also so many random starts")
    starts = parser.parse_args().starts
    if starts:
        any_start(starts)
        return
    paper = load([CONFIG / "paper.yaml"])
    task(paper)
    envelopes()
    rate_bounds()
    cross_term_ratio()
    along_the_run(paper)
    largest_start(paper)
    sample_times(paper)
    saturated(paper)
    margins(paper)
    hits()
    benchmark()


if __name__ == "__main__":
    main()
