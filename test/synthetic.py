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

"""Records of runs that never were, with known truth: what the analysis is tested on."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.verdict import Requirement
from ppc_attitude.contract.declared import BY_COLUMN
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.simulation.diagram import recorded_columns
from ppc_attitude.simulation.scenario import scenario

RADIAN = np.pi / 180.0

SAMPLED = tuple(BY_COLUMN[column.name] for column in recorded_columns(scenario({}).parameters))
"""Topics of a run of the paper's case that have a sample a step."""


def environment(t: Array) -> Array:
    """The paper's environment torque (eq. 34, ω_p = 0.01 rad/s), shape (n, 3) [N·m]."""
    w = 0.01 * t
    return 1e-4 * np.column_stack(
        [
            4 * np.sin(3 * w) + 3 * np.cos(10 * w) - 20,
            -1.5 * np.sin(2 * w) + 3 * np.cos(5 * w) + 20,
            3 * np.sin(10 * w) - 8 * np.cos(4 * w) + 20,
        ]
    )


def times(duration: float, rate: float = 100.0) -> tuple[np.ndarray, Array]:
    """Stamps [ns] from zero to the duration, and the same in seconds."""
    stamps = np.round(np.arange(round(duration * rate) + 1) * (1e9 / rate)).astype(np.int64)
    return stamps, stamps / 1e9


def pulse_torque(t: Array, pulses: list[tuple[float, float, tuple[float, float, float]]]) -> Array:
    """Sum of pulses (start, duration, torque), each on [start, start + duration)."""
    total = np.zeros((t.size, 3))
    for start, duration, torque in pulses:
        inside = (t > start - 1e-9) & (t < start + duration - 1e-9)
        total[inside] += torque
    return total


def normal_run(duration: float = 120.0, rate: float = 100.0) -> RunRecord:
    """A run that meets every requirement: errors decay inside their envelopes, nothing hits."""
    stamps, t = times(duration, rate)
    decay = np.exp(-0.09 * t)[:, None]
    error = np.array([-0.23, 0.26, -0.11]) * decay + 2e-5 * np.sin(t)[:, None]
    scalar = -np.sqrt(1.0 - (error**2).sum(axis=1))
    rho_q = np.repeat((0.995 * np.exp(-0.05 * t) + 5e-3)[:, None], 3, axis=1)
    rho_w = np.repeat((0.08 * np.exp(-0.2 * t) + 3e-5)[:, None], 3, axis=1)
    z2 = 0.3 * rho_w * np.sin(np.column_stack([t, t + 1.0, t + 2.0]))
    turning = np.column_stack([np.sin(0.01 * t), 0 * t, 0 * t, np.cos(0.01 * t)])
    reference_rate = (
        0.5 * RADIAN * np.column_stack([np.cos(t / 30), np.sin(t / 20), -np.cos(t / 40)])
    )
    rate_s = reference_rate + np.array([0.02, 0.01, -0.02]) * decay
    u = np.array([0.3, -0.06, 0.02]) * decay * np.cos(t)[:, None]
    columns = {
        "angular_velocity": rate_s,
        "applied_torque": np.clip(u, -0.05, 0.05),
        "reference_attitude": turning,
        "reference_angular_velocity": reference_rate,
        "reference_angular_acceleration": np.zeros((t.size, 3)),
        "torque_command": np.clip(u, -0.05, 0.05),
        "disturbance_torque": environment(t),
        "attitude_envelope": rho_q,
        "rate_error": z2,
        "rate_envelope": rho_w,
        "auxiliary_state": 1e-3 * decay * np.sin(np.column_stack([t, 2 * t, 3 * t])),
        "unsaturated_torque": u,
    }
    parameters = {
        "spacecraft_plant": {
            "rate": rate,
            "max_torque": 0.05,
            "inertia": [2.8, 0.0, 0.0, 0.0, 2.5, 0.0, 0.0, 0.0, 1.9],
            "attitude_noise": 0.0,
            "rate_noise": 0.0,
        },
        "reference_generator": {"period_constant": [30.0, 20.0, 40.0]},
        "ppc_controller": {"controller": "ppc", "k": 3.0},
        "disturbance_injector": {"environment": True},
    }
    run = RunRecord(
        source="simulate",
        controller="ppc",
        stamps_ns=stamps,
        columns=columns,
        parameters=parameters,
        metadata={"ppc_attitude": "1.0.0", "seed": "1"},
    )
    return with_error(run, np.column_stack([error, scalar]))


def hit_run(duration: float = 120.0, hits: tuple[float, ...] = (20.0, 80.0)) -> RunRecord:
    """A run with 0.1 s hits of 0.8 N·m on every axis, each recovered in 3.4 s.

    Each throws the error to 0.02 (and widens its envelope), and z2 outside for 0.16 s.
    """
    run = normal_run(duration)
    t = run.stamps_ns / 1e9
    error, rho_q = run["attitude_error"].copy(), run["attitude_envelope"].copy()
    z2, rho_w = run["rate_error"].copy(), run["rate_envelope"]
    rate = run["angular_velocity"].copy()
    for start in hits:
        since = t - start
        bump = np.where(since > 0.005, 0.02 * np.exp(-np.maximum(since, 0) * 0.4), 0.0)
        error[:, 0] += bump
        rho_q += 2.0 * bump[:, None]
        rate += np.where(since > 0.005, 0.035 * np.exp(-np.maximum(since, 0) * 0.5), 0.0)[:, None]
        outside = (since > -0.005) & (since < 0.155)
        z2[outside] = 1.5 * rho_w[outside]
    torque = run["disturbance_torque"] + pulse_torque(
        t, [(start, 0.1, (0.8, 0.8, 0.8)) for start in hits]
    )
    error[:, 3] = -np.sqrt(1.0 - (error[:, :3] ** 2).sum(axis=1))
    return with_columns(
        with_error(run, error),
        attitude_envelope=rho_q,
        rate_error=z2,
        angular_velocity=rate,
        disturbance_torque=torque,
    )


def turned(attitude: Array, turns: Array) -> Array:
    """Attitudes x y z w turned in body axes by quaternions, both of shape (n, 4)."""
    return (Rotation.from_quat(attitude) * Rotation.from_quat(turns)).as_quat()


def with_error(run: RunRecord, error: Array) -> RunRecord:
    """The run with an attitude error x y z w, shape (n, 4): in truth, as told and as reported."""
    attitude = turned(run["reference_attitude"], error)
    return with_columns(run, attitude=attitude, attitude_error=error)


def with_columns(run: RunRecord, **columns: Array) -> RunRecord:
    """The run with some columns replaced or added."""
    return replace(run, columns={**run.columns, **columns})


def with_parameters(run: RunRecord, node: str, values: Mapping[str, Any]) -> RunRecord:
    """The run with some parameters of a node replaced or added."""
    own = {**run.parameters.get(node, {}), **values}
    return replace(run, parameters={**run.parameters, node: own})


def with_rows(run: RunRecord, column: str, instants: Any, values: ArrayLike) -> RunRecord:
    """The run with other samples of a column at some of its instants."""
    rows = run[column].copy()
    rows[instants] = values
    return with_columns(run, **{column: rows})


def part_of(run: RunRecord, instants: slice | np.ndarray) -> RunRecord:
    columns = {name: samples[instants] for name, samples in run.columns.items()}
    return replace(run, stamps_ns=run.stamps_ns[instants], columns=columns)


def without_columns(run: RunRecord, *names: str) -> RunRecord:
    return replace(run, columns={k: v for k, v in run.columns.items() if k not in names})


def requirement(verdict: Verdict, key: str) -> Requirement:
    return next(each for each in verdict.requirements if each.key == key)
