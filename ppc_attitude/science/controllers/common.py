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

"""Parameters and columns of envelopes, which laws with envelopes share."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from ppc_attitude.science.component import BODY, VECTOR, Column, Component
from ppc_attitude.science.kernel import Vector, divide, kernel, scale, tanh
from ppc_attitude.science.parameter import Parameter
from ppc_attitude.science.performance import (
    LARGEST_INITIAL,
    EnvelopeTable,
    solve_envelope,
)

INERTIA = Parameter(
    "inertia",
    [2.8, 0.0, 0.0, 0.0, 2.5, 0.0, 0.0, 0.0, 1.9],
    "inertia J that the law assumes, row-major; symmetric positive definite",
    "kg·m²",
    length=9,
)
MAX_TORQUE = Parameter(
    "max_torque", 0.05, "torque limit per axis, sat(u)", "N·m", above=0.0, high=1e6
)
D_M = Parameter("D_m", 0.00457, "bound of the disturbance, gain of its estimate", "N·m", low=0.0)
MU = Parameter(
    "mu",
    0.703,
    "width μ of the tanh in the disturbance estimate; of log_barrier in rad/s",
    above=0.0,
)


def envelope_parameters(prefix: str, what: str, unit: str, table: EnvelopeTable) -> list[Parameter]:
    """Parameters of one nominal envelope; its tables are the paper's."""
    return [
        Parameter(
            f"{prefix}.initial",
            table.initial,
            f"initial value ρ_e0 of the {what}",
            unit,
            above=0.0,
            high=LARGEST_INITIAL,
        ),
        Parameter(
            f"{prefix}.exponential_terminal",
            table.exponential_terminal,
            f"final value ρ_e∞ of the exponential part of the {what}",
            unit,
            above=0.0,
        ),
        Parameter(f"{prefix}.decay", table.decay, f"decay rate l of the {what}", "1/s", above=0.0),
        Parameter(
            f"{prefix}.settling_time",
            table.settling_time,
            f"settling time t2 of the {what}, from which on it is terminal",
            "s",
            above=0.0,
        ),
        Parameter(  # the square of a smaller one would have no finite inverse
            f"{prefix}.terminal",
            table.terminal,
            f"terminal value g∞ of the {what}",
            unit,
            low=1e-30,
        ),
    ]


# Table I of the paper.
ATTITUDE_TABLE = EnvelopeTable(1.0, 1e-4, 0.05, 60.0, 5e-3)
# Table II has no solution (r = 1.76e5, at most e/2); this is the nearest table that has one.
RATE_TABLE = EnvelopeTable(0.08, 3e-5, 0.5, 40.0, 3e-5)

ATTITUDE_PARAMETERS = envelope_parameters(
    "attitude_envelope", "attitude envelope", "", ATTITUDE_TABLE
)
RATE_PARAMETERS = envelope_parameters("rate_envelope", "rate envelope", "rad/s", RATE_TABLE)


def of_law(name: str, form: str, frame: str, unit: str, meaning: str, **options: Any) -> Column:
    """Column that a law gives, on the topic control/<name>; arguments as of `Column`."""
    return Column(name, f"control/{name}", form, frame, unit, meaning, **options)


ATTITUDE_ENVELOPE = of_law(
    "attitude_envelope",
    VECTOR,
    BODY,
    "1",
    "envelope ρ_q of the attitude error",
    bounds="attitude_error",
)
RATE_ENVELOPE = of_law(
    "rate_envelope", VECTOR, BODY, "rad/s", "envelope ρ_ω of the rate error", bounds="rate_error"
)


def envelopes_of(law: Component) -> tuple[str, ...]:
    """Prefixes of the nominal envelopes that a law is configured with, among ours."""
    prefixes = (ATTITUDE_ENVELOPE.name, RATE_ENVELOPE.name)
    return tuple(each for each in prefixes if f"{each}.terminal" in law.defaults)


def envelope_of(prefix: str, values: Mapping[str, Any]) -> Any:
    """Solve the envelope whose five numbers have this prefix, as the record that kernels read.

    Raises
    ------
    ConfigurationError
        The envelope is infeasible.
    """
    table = EnvelopeTable(*(values[f"{prefix}.{each.name}"] for each in fields(EnvelopeTable)))
    return solve_envelope(prefix, table)


@kernel
def smooth_sign(a: Vector, size: float, width: float) -> Vector:
    """Estimate D_m tanh(a/μ) of a disturbance [N·m], with the size D_m and the width μ."""
    return scale(size, tanh(divide(a, (width, width, width))))
