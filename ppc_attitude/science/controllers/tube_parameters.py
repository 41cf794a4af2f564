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

"""Parameters of the momentum-tube law, and the digest of those that a certificate is for."""

import hashlib
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ppc_attitude.science.controllers.common import INERTIA, MAX_TORQUE
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.inertia import inertia_matrix
from ppc_attitude.science.parameter import Parameter, exact_text, record_type

PREFIX = "momentum_tube."
LAW, LAW_AHEAD = "momentum_tube", "momentum_tube_ahead"
LAWS = (LAW, LAW_AHEAD)
# The certified numbers of config/guaranteed.yaml: the paper's craft at 100 Hz.
# Least values are far below those of any craft; they keep the law's quotients and powers finite.
_OWN = (
    Parameter("h", 0.01, "sample time: the largest gap between two samples", "s", low=1e-9),
    Parameter("k", 1.0, "rate at which a small error falls", "1/s", low=1e-9),
    Parameter("kappa", 15.4, "κ: rate at which the momentum error falls", "1/s", above=0.0),
    Parameter(
        "ell", 0.2, "ℓ: gain of the momentum observer; 1 switches it off", low=1e-9, high=1.0
    ),
    Parameter(
        "brake",
        [0.0348649951, 0.0354519383, 0.0440801058],
        "T: torque that the brake may use, per axis",
        "N·m",
        length=3,
        low=1e-9,
    ),
    Parameter(
        "a_most", 0.0174501876, "largest deceleration of the brake", "rad/s²", low=1e-9, high=1e6
    ),
    Parameter(
        "a_rate",
        0.00125756416,
        "largest rate |a'| of the deceleration a where the brake acts",
        "rad/s³",
        low=0.0,
    ),
    Parameter("Omega_e", 0.0514731821, "Ω_e: largest commanded rate ‖ω_s‖", "rad/s", above=0.0),
    Parameter(
        "Y",
        [0.00120822862, 0.00118143959, 0.0011255683],
        "tube: largest momentum error, per axis",
        "N·m·s",
        length=3,
        above=0.0,
    ),
    Parameter(
        "B",
        [0.0434528907, 0.0436678902, 0.0441197343],
        "torque that feedforward and ramps of the rate may use, per axis",
        "N·m",
        length=3,
        above=0.0,
    ),
    Parameter(
        "B_ramp",
        0.05,
        "torque that ramps of the rate may use at zero momentum error; B from half the tube on",
        "N·m",
        low=0.0,
    ),
    Parameter("z_bar", 0.000872051288, "z̄: largest rate error in the tube", "rad/s", above=0.0),
    Parameter(
        "V_rate",
        0.00141294616,
        "largest rate |V'| of the speed cap V where it acts",
        "rad/s²",
        low=0.0,
    ),
    Parameter(
        "far",
        0.564661399,
        "error from which the craft cruises",
        "rad",
        above=0.0,
        high=math.pi,
    ),
    Parameter("w_far", 0.0354752803, "rate up to which the craft cruises", "rad/s", above=0.0),
    Parameter(
        "omega0",
        0.10472,
        "rate error from which the craft counts as tumbling",
        "rad/s",
        low=1e-9,
    ),
    Parameter("d_max", 0.0045927, "bound of the disturbance estimate", "N·m", low=0.0),
    Parameter(
        "N",
        [0.0] * 3,
        "error of the momentum error y that estimation errors cause, per axis",
        "N·m·s",
        length=3,
        low=0.0,
    ),
    Parameter("e_A", 0.0, "largest estimation error of the attitude", "rad", low=0.0),
    Parameter(
        "lead",
        0.0,
        "angle beyond half a turn that the law may still go round to meet the desired frame",
        "rad",
        low=0.0,
        high=1.0,
    ),
)
# What the certificate assumes; the law itself reads none of it.
_ASSUMPTIONS = (
    Parameter(
        "dead_band", 1e-4, "command below which the actuator gives no torque", "N·m", low=0.0
    ),
    Parameter("d", 4.374e-3, "bound of the disturbance, per axis", "N·m", low=0.0),
    Parameter(
        "momentum",
        0.0,
        "bound of the whole momentum ‖Jω + h‖ of a craft with wheels",
        "N·m·s",
        low=0.0,
    ),
    Parameter("W", 0.01392, "bound of ‖ω_d‖", "rad/s", low=0.0),
    Parameter("W1", 5.515e-4, "bound of ‖ω_d'‖", "rad/s²", low=0.0),
    Parameter("W2", 2.449e-5, "bound of ‖ω_d''‖", "rad/s³", low=0.0),
    Parameter("Omega", math.radians(3.0), "rate limit of the craft, ‖ω_s‖", "rad/s", above=0.0),
    Parameter(
        "eta", 1.0, "least share of the command that the actuator gives", above=0.0, high=1.0
    ),
    Parameter("e_S", 0.0, "relative error of the inertia, about any axis", low=0.0, high=0.5),
    Parameter("e_W", 0.0, "largest estimation error of the rate", "rad/s", low=0.0),
    Parameter("late", 0.0, "1: a command may act up to a sample late", low=0.0, high=1.0),
)
ASSUMED = tuple(each.name for each in _ASSUMPTIONS)
CERTIFICATE = Parameter(
    PREFIX + "certificate",
    "",
    "digest of the numbers that a certificate was issued for; empty: none was",
)
PARAMETERS = (
    CERTIFICATE,
    INERTIA,
    MAX_TORQUE,
    *(replace(each, name=PREFIX + each.name) for each in _OWN),
    *(replace(each, name=f"{PREFIX}assumed.{each.name}") for each in _ASSUMPTIONS),
)
CONFIGURATION = record_type(
    *_OWN,
    MAX_TORQUE,
    ("inertia", np.float64, (3, 3)),
    ("admitted", np.float64, (3,)),  # [N·m] unexplained torque that the assumptions admit
    ("certified", np.float64),  # 1 if the certificate is for these numbers, −1 if for others
    ("numbers", np.float64),  # above 0; tells these numbers from others, with their certificate
    ("tumbling_momentum", np.float64),  # [N·m·s] full torque from this component on
)
_TUMBLING_BAND = 0.1  # of the least momentum at omega0: where the stopping torque is linear


def digest_of(values: Mapping[str, Any]) -> str:
    """SHA-256 of every number that a certificate depends on, to the last bit."""
    lines = [
        f"{each.name} {[float(x).hex() for x in np.atleast_1d(values[each.name])]}"
        for each in PARAMETERS
        if each is not CERTIFICATE
    ]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def configure(values: Mapping[str, Any]) -> Any:
    """Build the kernel's record from checked parameter values.

    Raises
    ------
    ConfigurationError
        The inertia is impossible, or the torque for brake, feedforward or ramps exceeds max_torque.
    """
    record = np.zeros((), CONFIGURATION)[()]
    for each in _OWN:
        record[each.name] = values[PREFIX + each.name]
    inertia = inertia_matrix("inertia", values["inertia"])
    record["inertia"] = inertia
    record["max_torque"] = values["max_torque"]
    digest = digest_of(values)
    if values[CERTIFICATE.name]:
        record["certified"] = 1.0 if values[CERTIFICATE.name] == digest else -1.0
    # A float64 holds twelve hexadecimal digits, and three times their number, exactly.
    record["numbers"] = 3.0 * int(digest[:12], 16) + record["certified"] + 2.0
    record["tumbling_momentum"] = _TUMBLING_BAND * np.linalg.eigvalsh(inertia)[0] * record["omega0"]
    record["admitted"] = _admitted(record, values)
    for name in ("brake", "B", "B_ramp"):
        if record[name].max() > record["max_torque"]:
            raise ConfigurationError(
                f"{PREFIX}{name} = {record[name].tolist()} N·m; allowed: at most max_torque = "
                f"{exact_text(values['max_torque'])} N·m"
            )
    return record


def observer_spread(eta: float, follow: Any, weak: Any) -> Any:
    """Factor by which the observer's error widens the tube in C1, for floats or intervals.

    The share of the errors N of y grows by 1 / weak, which is the larger factor where η < ½.

    Parameters
    ----------
    eta : float
        Least share η of the command that the actuator gives.
    follow, weak : number
        x = κ λ_o, and 1 - 2 (1 - η) x, which is positive.
    """
    return 1 + follow / weak if eta >= 0.5 else 1 / weak


def _admitted(record: Any, values: Mapping[str, Any]) -> Any:
    """Bound [N·m] per axis of |F + τ − y'| that C1 implies: what κ Y leaves beside d̂ and N."""
    eta, late = (values[f"{PREFIX}assumed.{name}"] for name in ("eta", "late"))
    step = record["kappa"] * record["h"]
    follow = step * (1.0 - record["ell"]) / record["ell"]  # κ λ_o
    slow = observer_spread(eta, follow, max(1.0 - 2.0 * (1.0 - eta) * follow, 1e-3))
    late_jumps = late * 6.0 * record["max_torque"]
    tube = record["kappa"] * record["Y"] / slow - record["d_max"] - record["kappa"] * record["N"]
    return np.maximum(tube, 0.0) + (1.0 - eta) * record["max_torque"] + late_jumps
