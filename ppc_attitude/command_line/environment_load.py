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

"""What the configured environment does to a craft in a run: its torque, and momentum of wheels."""

import math
from collections.abc import Iterator

import numpy as np

from ppc_attitude.contract.declared import has_parameter
from ppc_attitude.contract.topics import INJECTOR, PLANT
from ppc_attitude.science import magnetorquers, wheels
from ppc_attitude.science.attitude import conjugate, rotate
from ppc_attitude.science.certificate import Condition
from ppc_attitude.science.guarantee.actuation import held_momentum
from ppc_attitude.science.kernel import quaternion, vector
from ppc_attitude.science.part import Part
from ppc_attitude.science.plants.rigid_body import INERTIA
from ppc_attitude.science.signals import (
    ENVIRONMENT_TORQUE,
    REFERENCE_ATTITUDE,
    REFERENCE_RATE,
    TRUE_ATTITUDE,
    TRUE_RATE,
)
from ppc_attitude.science.stamps import NANOSECONDS
from ppc_attitude.simulation.scenario import Scenario

_SAMPLES = 1000  # times at which an environment is looked at
_LONGEST = 10.0  # [s] between two of them, where momentum is summed


def environment_torque(scenario: Scenario, environment: Part) -> float:
    """Bound of the norm [N·m] of the configured environment's torque.

    Of an environment that tells none it is the largest at even times of the run, or, where it looks
    at the craft, at the first instant, which `environment` has made.
    """
    component = environment.component
    if component.bound:
        return component.bound(scenario.parameters[INJECTOR])
    duration_ns = round(scenario.number(PLANT, "duration") * NANOSECONDS)
    count = 0 if component.inputs else _SAMPLES + 1
    torques = [environment.outputs[ENVIRONMENT_TORQUE.name][0].copy()]
    for stamp_ns in np.linspace(0, duration_ns, count, dtype=np.int64).tolist():
        environment.step(stamp_ns)
        torques.append(environment.outputs[ENVIRONMENT_TORQUE.name][0].copy())
    return float(np.linalg.norm(torques, axis=1).max())


def momentum_conditions(
    scenario: Scenario, reference: Part, environment: Part
) -> Iterator[Condition]:
    """Compare the momentum that a run gives to wheels without rods with what they hold.

    The craft is taken as if it followed the reference, from wheels at rest. Both parts have made a
    step, and are stepped anew.
    """
    plant, end = scenario.parameters[PLANT], scenario.number(PLANT, "duration")
    known = TRUE_ATTITUDE, TRUE_RATE
    unloaded = has_parameter(PLANT, plant, magnetorquers.MAX_DIPOLE.name) and (
        plant.get(magnetorquers.LAW.name) != "off"
    )
    if unloaded or not end or not has_parameter(PLANT, plant, wheels.AXES.name):
        return
    if not set(environment.component.inputs) <= set(known):
        return
    first = reference.signals[2 : reference.inputs.nbytes // 8].tolist()  # behind the instant
    for part in (reference, environment):
        part.forget()
    count = max(_SAMPLES, math.ceil(end / _LONGEST))
    inertia, held = np.reshape(plant[INERTIA.name], (3, 3)), held_momentum(plant)
    given, most, full = np.zeros(3), 0.0, math.inf  # given: inertial axes
    for stamp_ns in np.linspace(0, round(end * NANOSECONDS), count + 1, dtype=np.int64).tolist():
        reference.step(stamp_ns, first)
        q, rate = (reference.output(each.name) for each in (REFERENCE_ATTITUDE, REFERENCE_RATE))
        attitude = quaternion(q)
        stored = rotate(conjugate(attitude), vector(given)) - inertia @ rate
        most = max(most, float(np.linalg.norm(stored)))
        full = min(full, stamp_ns / NANOSECONDS) if most > held else full
        seen = dict(zip(known, (q, rate), strict=True))
        environment.step(stamp_ns, (x for each in environment.component.inputs for x in seen[each]))
        torque = rotate(attitude, vector(environment.output(ENVIRONMENT_TORQUE.name)))
        given += end / count * np.array(torque)
    passed = f", passed at {full:.4g} s" if full <= end else ""
    yield Condition(
        "momentum of the wheels",
        most,
        held,
        "≤",
        "N·m·s",
        False,
        f"what {end:g} s of the environment give to wheels at rest, if the craft follows its "
        f"reference; in some directions they hold no more than the limit{passed}",
    )
