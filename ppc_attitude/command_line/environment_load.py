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

"""What the configured environment does to a craft in a run: its torque, and speeds of wheels."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from ppc_attitude.analysis.reserves import RESERVE
from ppc_attitude.contract.declared import craft_of, parameters_in_use
from ppc_attitude.contract.topics import INJECTOR, PLANT
from ppc_attitude.science import magnetorquers, wheels
from ppc_attitude.science.allocation import certain_torque
from ppc_attitude.science.allocators import wheel_drive
from ppc_attitude.science.attitude import conjugate, normalised, rotate
from ppc_attitude.science.component import MAX_WHEELS
from ppc_attitude.science.conditions import Condition, advisable
from ppc_attitude.science.disturbances.pulses import scheduled_pulses
from ppc_attitude.science.faults import fault_of, fault_texts
from ppc_attitude.science.kernel import quaternion, vector
from ppc_attitude.science.part import Part
from ppc_attitude.science.plants.rigid_body import INERTIA, INITIAL_ATTITUDE, INITIAL_RATE
from ppc_attitude.science.sensors.star_tracker import MAX_RATE
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
_LONGEST = 10.0  # [s] between two of them, where the momentum of wheels is summed
_UNLIMITED = 1e6  # [rad/s] no limit of speed


def environment_torque(scenario: Scenario, environment: Part) -> float:
    """Bound of the norm [N·m] of the configured environment's torque.

    If the environment declares no bound, it is the largest norm at evenly spaced times of the run;
    if it reads the craft's state, only that of the first instant, which `environment` has made.
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


def loss_conditions(scenario: Scenario, environment: float) -> Iterator[Condition]:
    """Compare what wheels give while scheduled faults take some with the environment [N·m]."""
    plant, left = scenario.parameters[PLANT], []
    if wheels.AXES.name not in parameters_in_use(PLANT, plant):
        return
    drive = Part(wheel_drive.COMPONENT, {**plant, wheel_drive.DETECTION_DELAY.name: 0.0})
    axes = wheels.axes_of(plant)
    limits = np.broadcast_to(plant[wheels.MAX_TORQUE.name], len(axes))
    for stamp_ns in sorted(fault_of(text).start_ns for text in fault_texts(plant)):
        drive.step(stamp_ns, [0.0] * (6 + MAX_WHEELS))
        lost = drive.state["lost"][0, : len(axes)]
        if lost.any():
            spans = drive.state["rank"][0] == 3  # else rounding leaves 1e-18 N·m
            left.append(certain_torque(axes, (1.0 - lost) * limits) if spans else 0.0)
    if left:
        meaning = "the wheels that scheduled faults leave at the worst give more torque on every "
        meaning += "axis than the largest norm of the environment's"
        yield Condition("torque with faults", min(left), environment, ">", "N·m", False, meaning)


def wheel_conditions(scenario: Scenario, reference: Part, environment: Part) -> Iterator[Condition]:
    """Compare the speeds to which a run brings the wheels with their largest.

    It is assumed that the craft follows the reference, that the wheels share the momentum as the
    drive does, and that magnetorquers take up that of the environment, and of nothing else but a
    tumble that B-dot slows. Both parts have made a step, and are stepped anew.
    """
    plant, end = scenario.parameters[PLANT], scenario.number(PLANT, "duration")
    known, given = (TRUE_ATTITUDE, TRUE_RATE), craft_of(scenario.parameters)
    law = given.get(magnetorquers.LAW.name)
    unloaded = magnetorquers.MAX_DIPOLE.name in given and law != "off"
    needed = wheels.AXES, INERTIA, INITIAL_ATTITUDE, INITIAL_RATE
    if not end or not all(each.name in given for each in needed):
        return
    if not set(environment.component.inputs) <= set(known):
        return
    first = reference.signals[2 : reference.inputs.nbytes // 8].tolist()  # behind the instant
    for part in (reference, environment):
        part.forget()
    # Without limits of speed, because the condition tells how far beyond them the wheels would be.
    free: dict[str, Any] = {wheels.MAX_SPEED.name: [_UNLIMITED], wheels.VISCOUS.name: [0.0]}
    count, gain = max(_SAMPLES, math.ceil(end / _LONGEST)), wheel_drive.NULL_GAIN.name
    free[gain] = min(plant[gain], count / end)  # with a longer step idle wheels oscillate
    drive, craft = Part(wheel_drive.COMPONENT, {**plant, **free}), wheels.wheel_record(plant)
    inertia, speeds = np.reshape(plant[INERTIA.name], (3, 3)), craft["initial_speed"].copy()
    start = quaternion(normalised(tuple(plant[INITIAL_ATTITUDE.name])))
    # Momentum of craft and wheels [N·m·s]: in inertial axes only external torques change it.
    omega = np.array(plant[INITIAL_RATE.name])
    # With B-dot the wheels rest until the tracker has a fix.
    if law == magnetorquers.B_DOT and MAX_RATE.name in given:
        omega *= min(1.0, given[MAX_RATE.name] / (np.linalg.norm(omega) or 1.0))
    whole = inertia @ omega + wheels.momentum(craft, speeds)
    whole = np.array(rotate(start, vector(whole)))
    turning, hits = slice(craft["count"]), scheduled_pulses(scenario.parameters[INJECTOR])
    net = drive.state["net"][0, turning]
    moments, most = (craft[each][turning] for each in ("inertia", "max_speed"))
    times, shares = np.linspace(0.0, end, count + 1), []
    for stamp_ns in np.rint(times * NANOSECONDS).astype(np.int64).tolist():
        reference.step(stamp_ns, first)
        q, rate = (reference.output(each.name) for each in (REFERENCE_ATTITUDE, REFERENCE_RATE))
        attitude = quaternion(q)
        stored = rotate(conjugate(attitude), vector(whole)) - inertia @ rate
        torque = (wheels.momentum(craft, speeds) - stored) * count / end
        drive.step(stamp_ns, (*torque, 0.0, 0.0, 0.0, *speeds))
        speeds[turning] += end / count * net / moments
        shares.append(float((np.abs(speeds[turning]) / most).max()))
        seen = dict(zip(known, (q, rate), strict=True))
        environment.step(stamp_ns, (x for each in environment.component.inputs for x in seen[each]))
        ends, starts = hits["end_ns"], np.maximum(hits["start_ns"], stamp_ns)
        lasts = np.maximum(np.minimum(ends, stamp_ns + end / count * NANOSECONDS) - starts, 0.0)
        acts = 0.0 if unloaded else end / count * environment.outputs[ENVIRONMENT_TORQUE.name][0]
        whole += rotate(attitude, vector(acts + lasts / NANOSECONDS @ hits["torque"]))
    full = times[np.array(shares) > RESERVE]
    passed = f"; a wheel exceeds the limit from {full[0]:.4g} s on" if full.size else ""
    source, also = " of the environment's torque and of pulses", ""
    if unloaded:
        source, also = "", " and magnetorquers take up the environment's torque"
    yield advisable(
        "speed of a wheel",
        max(shares),
        RESERVE,
        "",
        f"largest share of its speed limit that a wheel reaches in {end:g} s{source}, if the craft "
        f"follows its reference{also}{passed}",
    )
