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

"""How fast any law could be: the time-optimal turn by direct multiple shooting, and a figure.

pip install 'ppc_attitude[bench]'
python docs/examples/time_optimal.py
python docs/examples/time_optimal.py --figure docs/images/time_optimal.png

The optimum knows reference and disturbance beforehand, and gives any torque within the limits. The
solver finds local optima, and the rate limit is kept at the nodes only.
"""

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi
import matplotlib
import numpy as np
from numpy.typing import NDArray

from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import Scenario, load

CONFIG = Path(__file__).parents[2] / "config"
SETTLED = 5e-3  # of |q_ev,i|
RATE_LIMIT = math.radians(3.0)  # [rad/s]
KEPT = 4.0  # [s] for which the error must stay small
TURN, KEEP = 100, 20  # intervals of the turn, and of what follows
HIT_TORQUE, HIT_TIME, HIT_LENGTH = 0.8, 80.0, 0.1  # [N·m] on every axis, [s], [s]
LAWS = {
    "ppc": (),
    "log_barrier": ("any_start",),
    "quaternion_feedback": (),
    "momentum_tube, quiet": ("guaranteed_quiet",),
    "momentum_tube, standard": ("guaranteed",),
    "momentum_tube, sharp": ("guaranteed_sharp",),
    "momentum_tube_ahead": ("guaranteed_ahead",),
}


@dataclass(frozen=True)
class Optimum:
    """A time-optimal turn.

    Attributes
    ----------
    time : float
        Until every |q_ev,i| is, and stays, below 5e-3 [s].
    t : ndarray, shape (n,)
        Nodes [s], from the instant at which the turn begins.
    error : ndarray, shape (n,)
        Largest |q_ev,i| there.
    """

    time: float
    t: NDArray[np.float64]
    error: NDArray[np.float64]


def scenario_of(law: str, overlays: tuple[str, ...], **nodes: dict[str, Any]) -> Scenario:
    """Return the paper's case with a law."""
    files = [CONFIG / f"{name}.yaml" for name in ("paper", *overlays)]
    return load(files, {"ppc_controller": {"controller": law.partition(",")[0]}} | nodes)


def slope(x: Any, torque: Any, t: Any, scenario: Scenario) -> Any:
    """Return x' of x = (q_e, ω_s): error kinematics, and Euler's equation with the environment.

    q_e' = ½ q_e ⊗ [ω_s − C_e ω_d, 0], J ω_s' = τ + d − ω_s × J ω_s.
    """
    reference = scenario.parameters["reference_generator"]
    a, period = reference["amplitude"], reference["period_constant"]
    omega_d = casadi.vertcat(
        a[0] * casadi.cos(t / period[0]),
        a[1] * casadi.sin(t / period[1]),
        -a[2] * casadi.cos(t / period[2]),
    )
    inertia = casadi.DM(np.reshape(scenario.parameters["spacecraft_plant"]["inertia"], (3, 3)))
    q, q0, omega = x[:3], x[3], x[4:]
    # C_e turns what the desired frame says into the body's.
    twice = 2.0 * casadi.cross(q, omega_d)
    omega_e = omega - (omega_d - q0 * twice + casadi.cross(q, twice))
    p = 0.01 * t  # eq. 34
    disturbance = 1e-4 * casadi.vertcat(
        4.0 * casadi.sin(3.0 * p) + 3.0 * casadi.cos(10.0 * p) - 20.0,
        -1.5 * casadi.sin(2.0 * p) + 3.0 * casadi.cos(5.0 * p) + 20.0,
        3.0 * casadi.sin(10.0 * p) - 8.0 * casadi.cos(4.0 * p) + 20.0,
    )
    momentum = inertia @ omega
    return casadi.vertcat(
        0.5 * (q0 * omega_e + casadi.cross(q, omega_e)),
        -0.5 * casadi.dot(q, omega_e),
        casadi.solve(inertia, torque + disturbance - casadi.cross(omega, momentum)),
    )


def moved(x: Any, torque: Any, t: Any, h: Any, scenario: Scenario) -> Any:
    """Return x after h [s] of a constant torque [N·m], by a Runge-Kutta step."""
    k1 = slope(x, torque, t, scenario)
    k2 = slope(x + h / 2 * k1, torque, t + h / 2, scenario)
    k3 = slope(x + h / 2 * k2, torque, t + h / 2, scenario)
    k4 = slope(x + h * k3, torque, t + h, scenario)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def optimum(
    start: NDArray[np.float64],
    begin: float,
    guess: tuple[float, NDArray[np.float64]],
    scenario: Scenario,
    *,
    limited: bool,
) -> Optimum:
    """Turn from q_e, ω_s at an instant [s] in the least time.

    Parameters
    ----------
    start : ndarray, shape (7,)
        q_e and ω_s [rad/s] at `begin`.
    begin : float
        Instant of reference and environment [s].
    guess : tuple
        A time [s], and q_e and ω_s on the nodes, shape (7, TURN + KEEP + 1).
    scenario : Scenario
        Craft and reference.
    limited : bool
        Keep the rate limit.
    """
    problem = casadi.Opti()
    x, torque = problem.variable(7, TURN + KEEP + 1), problem.variable(3, TURN + KEEP)
    time = problem.variable()
    most = scenario.number("spacecraft_plant", "max_torque")
    problem.minimize(time)
    problem.subject_to(problem.bounded(0.1, time, 200.0))
    problem.subject_to(x[:, 0] == start)
    problem.subject_to(problem.bounded(-most, casadi.vec(torque), most))
    t: Any = begin
    for k in range(TURN + KEEP):
        h = time / TURN if k < TURN else KEPT / KEEP
        problem.subject_to(x[:, k + 1] == moved(x[:, k], torque[:, k], t, h, scenario))
        t = t + h
        if limited:
            problem.subject_to(casadi.sumsqr(x[4:, k + 1]) <= RATE_LIMIT**2)
        if k >= TURN - 1:
            problem.subject_to(problem.bounded(-SETTLED, x[:3, k + 1], SETTLED))
    problem.set_initial(time, guess[0])
    problem.set_initial(x, guess[1])
    problem.solver("ipopt", {"print_time": False}, {"print_level": 0, "max_iter": 2000})
    found = problem.solve()
    least, states = float(found.value(time)), np.asarray(found.value(x))
    nodes = np.concatenate(
        [np.linspace(0.0, least, TURN + 1), least + np.linspace(0.0, KEPT, KEEP + 1)[1:]]
    )
    return Optimum(least, nodes, np.abs(states[:3]).max(axis=0))


def guess_of(record: RunRecord, begin: float, time: float) -> tuple[float, NDArray[np.float64]]:
    """Return what a law did, on the nodes."""
    nodes = np.concatenate(
        [np.linspace(0.0, time, TURN + 1), time + np.linspace(0.0, KEPT, KEEP + 1)[1:]]
    )
    states = np.hstack([record["attitude_error"], record["angular_velocity"]]).T
    return time, np.array([np.interp(begin + nodes, record.t, row) for row in states])


def settled(record: RunRecord, begin: float) -> float:
    """Last instant with an error of 5e-3 or more, from `begin` on [s]."""
    error = np.abs(record["attitude_error"][:, :3]).max(axis=1)
    return float(record.t[np.flatnonzero(error >= SETTLED)[-1]] - begin)


def hit() -> dict[str, Any]:
    """The hit on all axes."""
    return {
        "pulse_times": [HIT_TIME],
        "pulse_durations": [HIT_LENGTH],
        "pulse_torques": [HIT_TORQUE] * 3,
    }


def main() -> None:
    """Print both optima and what the laws need; draw them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args()
    runs = {
        name: (
            simulate(scenario_of(name, overlays), 120.0),
            simulate(scenario_of(name, overlays, disturbance_injector=hit()), 160.0),
        )
        for name, overlays in LAWS.items()
    }
    for name, (turn, struck) in runs.items():
        print(f"{name}: {settled(turn, 0.0):.2f} s, hit {settled(struck, HIT_TIME):.2f} s")
    standard = scenario_of("momentum_tube", ("guaranteed",))
    turn, struck = runs["momentum_tube, standard"]
    guess = guess_of(turn, 0.0, settled(turn, 0.0))
    fastest = optimum(guess[1][:, 0], 0.0, guess, standard, limited=True)
    print(f"paper's case, least time: {fastest.time:.2f} s")
    # That a hit comes is not known beforehand; from its beginning all torque acts against it.
    after = HIT_TIME + HIT_LENGTH
    state: Any = guess_of(struck, HIT_TIME, 1.0)[1][:, 0]
    push = casadi.DM([HIT_TORQUE - standard.number("spacecraft_plant", "max_torque")] * 3)
    for k in range(10):
        begin, h = HIT_TIME + k * HIT_LENGTH / 10.0, HIT_LENGTH / 10.0
        state = moved(casadi.DM(state), push, begin, h, standard)
    guess = guess_of(struck, after, settled(struck, after))
    recovery = optimum(state.full().ravel(), after, guess, standard, limited=False)
    print(f"hit, least time from its beginning: {HIT_LENGTH + recovery.time:.2f} s")
    if given.figure:
        draw(given.figure, runs, fastest, recovery)


def draw(
    path: Path, runs: dict[str, tuple[RunRecord, RunRecord]], turn: Optimum, recovery: Optimum
) -> None:
    """Draw the error of every law over time, and the least that is possible."""
    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 2, figsize=(11.0, 4.2), layout="constrained")
    for name, pair in runs.items():
        for axis, record, begin in zip(axes, pair, (0.0, HIT_TIME), strict=True):
            error = np.abs(record["attitude_error"][:, :3]).max(axis=1)
            axis.semilogy(record.t - begin, error, label=name, linewidth=1.2)
    for axis, found, late in zip(axes, (turn, recovery), (0.0, HIT_LENGTH), strict=True):
        bound = np.maximum(found.error, 1e-9)
        axis.semilogy(late + found.t, bound, "k--", label="time-optimal", linewidth=1.6)
        axis.axhline(SETTLED, color="grey", linewidth=0.8)
        axis.set_ylim(1e-4, 1.0)
        axis.set_ylabel("largest |q_ev,i|")
        axis.grid(alpha=0.3)
    axes[0].set_xlim(0.0, 60.0)
    axes[0].set_xlabel("time [s], the paper's case")
    axes[1].set_xlim(0.0, 12.0)
    axes[1].set_xlabel("time [s] since a hit of 0.8 N·m × 0.1 s on every axis")
    axes[0].legend(fontsize=8)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
