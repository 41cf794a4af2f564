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

"""Conditions of `check` on any selection of components: with each other, and with what is asked.

A component has conditions of its own, too (`Component.conditions`), which look at the `Task`.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ppc_attitude.analysis.requirements import Requirements
from ppc_attitude.contract.declared import components_of, craft_of
from ppc_attitude.contract.topics import CONTROLLER, ESTIMATOR, INJECTOR, PLANT, REFERENCE
from ppc_attitude.science.attitude import rotation_angle
from ppc_attitude.science.conditions import Condition, Task, advisable
from ppc_attitude.science.controllers.common import (
    ATTITUDE_ENVELOPE,
    MAX_TORQUE,
    RATE_ENVELOPE,
    envelope_of,
    envelopes_of,
)
from ppc_attitude.science.disturbances.pulses import scheduled_pulses
from ppc_attitude.science.estimators import mekf
from ppc_attitude.science.estimators.steady_state import (
    FLOOR,
    Sigmas,
    bias_in_innovation,
    error_sigmas,
)
from ppc_attitude.science.guidance.orders import GOAL_TIMES
from ppc_attitude.science.guidance.rotation import duration, profile
from ppc_attitude.science.inertia import inertia_error, inertia_matrix
from ppc_attitude.science.kernel import Quaternion
from ppc_attitude.science.kinds import ACTUATORS, ESTIMATORS, REFERENCES, SENSORS
from ppc_attitude.science.multibody import COUPLING, multibody_record
from ppc_attitude.science.performance import R_LIMIT
from ppc_attitude.science.plants.rigid_body import INERTIA, INITIAL_RATE
from ppc_attitude.science.references import goal
from ppc_attitude.science.sensors import gyro, gyro_star_tracker
from ppc_attitude.science.stamps import first_step, instant, seconds
from ppc_attitude.science.wheels import WHEELS
from ppc_attitude.simulation.scenario import Scenario

_HORIZON = 3600.0  # [s] for which a reference is looked at in a run without end
_PULSES = 3.0  # least pulses that should have room in the rate envelope
_INERTIA_ERROR = 0.3  # docs/guarantee.md has measured it


def conditions_of(
    scenario: Scenario, required: Requirements, q_e: Quaternion, environment: float
) -> Iterator[Condition]:
    """Yield the conditions that need no run; those of wheels and goals stand elsewhere.

    They look at the attitude error at the start, `q_e`, x y z w, and at the largest norm of the
    environment's torque [N·m].

    Raises
    ------
    ConfigurationError
        The parameters of a component are infeasible.
    """
    task, (_, most) = _task(scenario, required, q_e, environment), actuator_torques(scenario)
    yield from _of_actuator(scenario, task)
    yield from _of_envelopes(scenario, task)
    for node, values in scenario.parameters.items():
        for component in components_of(node, values):
            yield from component.conditions(values, task)
    yield from _of_settling(task, min(scenario.number(CONTROLLER, MAX_TORQUE.name), most))
    yield from _of_knowledge(scenario, task)
    yield from _of_pulses(scenario, required, task)


def _task(scenario: Scenario, required: Requirements, q_e: Quaternion, environment: float) -> Task:
    """The craft, and what is asked of it."""
    reference = scenario.parameters[REFERENCE]
    sigmas, (most, _) = _sigmas(scenario), actuator_torques(scenario)
    angle = math.degrees(rotation_angle(q_e))
    slews, times = REFERENCES.selected(reference) is goal.COMPONENT, reference[GOAL_TIMES.name]
    return Task(
        craft=craft_of(scenario.parameters),
        error=q_e,
        duration=scenario.number(PLANT, "duration"),
        desired_rate=_desired_rate(scenario),
        slews_from=min(times, default=math.inf) if slews else None,
        actuator_torque=most,
        torque=min(scenario.number(CONTROLLER, MAX_TORQUE.name), most),
        environment=environment,
        attitude_sigma=sigmas.attitude,
        rate_sigma=sigmas.rate,
        rate_limit=required.rate,
        settled=required.settled.bounds,
        deadline=required.settling_deadline,
        wish=f"an error of {required.settled} from rest at {angle:.4g}°",
    )


def _desired_rate(scenario: Scenario) -> float | None:
    """Largest ‖ω_d‖ [rad/s] of the selected reference; None if it tells none."""
    values = scenario.parameters[REFERENCE]
    reference = REFERENCES.selected(values)
    if reference is goal.COMPONENT:  # of a slew; see `Task.desired_rate`
        return float(values[goal.MAX_RATE.name])
    if reference is None or reference.motion_bounds is None:
        return None
    return reference.motion_bounds(values, scenario.number(PLANT, "duration") or _HORIZON)[0]


def actuator_torques(scenario: Scenario) -> tuple[float, float]:
    """Torque on an axis [N·m] that the selected actuator gives in any direction, and at most.

    If the actuator does not declare them, both are what the law may ask for.
    """
    plant = scenario.parameters[PLANT]
    actuator = ACTUATORS.selected(plant)
    limit = scenario.number(CONTROLLER, MAX_TORQUE.name)
    return (actuator.torques(plant) if actuator else None) or (limit, limit)


def _first_answer(scenario: Scenario, craft: Mapping[str, Any]) -> float:
    """Largest ratio of the first acceleration after a pulse to that which the law counts on.

    A torque first moves J − δᵀδ only, and flexible modes follow; 1 without modes.
    """
    if not craft.get(COUPLING.name):
        return 1.0
    known = inertia_matrix(INERTIA.name, scenario.parameters[CONTROLLER][INERTIA.name])
    plant = scenario.parameters[PLANT]
    inverse = multibody_record(plant, np.zeros((), WHEELS))["body"]["inertia_inverse"]
    return float(np.linalg.eigvals(inverse @ known).real.max())


def _sigmas(scenario: Scenario) -> Sigmas:
    """σ of the errors as the law sees them, on the axis on which it is largest.

    They are zero if whoever tells the law its motion declares no noise.
    """
    plant, estimator, law = (scenario.parameters[each] for each in (PLANT, ESTIMATOR, CONTROLLER))
    rate = scenario.number(PLANT, "rate")
    filtered = ESTIMATORS.selected(estimator)
    teller, values = (filtered, estimator) if filtered else (SENSORS.selected(plant), plant)
    if teller is None or teller.noise is None:
        return Sigmas(0.0, 0.0)
    return error_sigmas(law, rate, *teller.noise(values, rate))


def _of_settling(task: Task, torque: float) -> Iterator[Condition]:
    """The least time to settle with the largest torque that the actuator gives on an axis [N·m]."""
    if INERTIA.name in task.craft:
        limit = f" and within {task.rate_limit:g} deg/s" if task.rate_limit else ""
        who = f"or more about its eigenaxis, with at most {torque:.3g} N·m an axis{limit}"
        yield from task.settles("time to turn", _least_turn(task, torque), who)


def _least_turn(task: Task, torque: float) -> float:
    """Least time [s] about the eigenaxis, from rest, to where the error is small enough.

    The craft may still turn there, if it stops before the error on the other side is as large.
    """
    error = np.array(task.error[:3])
    if not error.any():
        return 0.0
    axis, (component, whole) = error / np.linalg.norm(error), task.settled
    near = 2.0 * math.asin(min(component / np.abs(axis).max(), whole, 1.0))
    inertia = inertia_matrix("inertia", task.craft[INERTIA.name])
    acceleration = float(torque / np.abs(inertia @ axis).max())
    rate = math.radians(task.rate_limit) if task.rate_limit else math.inf
    turn = max(rotation_angle(task.error) - near, 0.0)
    within = 2.0 * near  # from the one side to the other
    if turn <= within:
        return _from_rest(turn, rate, acceleration)
    whole_turn = profile(turn + within, rate, acceleration, math.inf)
    return float(duration(whole_turn)) - _from_rest(within, rate, acceleration)


def _from_rest(angle: float, rate: float, acceleration: float) -> float:
    """Time [s] in which a craft that speeds up, and goes on at its limit [rad/s], turns so far."""
    reached = min(math.sqrt(2.0 * acceleration * angle), rate)
    return angle / reached + 0.5 * reached / acceleration if reached else 0.0


def _of_envelopes(scenario: Scenario, task: Task) -> Iterator[Condition]:
    """Conditions on the law's envelopes, if it has ours: joint, noise of inputs, least pulses."""
    law, plant = scenario.parameters[CONTROLLER], scenario.parameters[PLANT]
    for prefix in envelopes_of(scenario.controller):
        symbol, unit, sigma = {
            ATTITUDE_ENVELOPE.name: ("ρ_q", "", task.attitude_sigma),
            RATE_ENVELOPE.name: ("ρ_ω", "rad/s", task.rate_sigma),
        }[prefix]
        envelope = envelope_of(prefix, law)
        joint = f"t1 = {envelope['t1']:.9g} s, a1 = {envelope['curvature']:.12g} 1/s²"
        meaning = f"the envelope has a smooth joint: {joint}"
        yield Condition(f"r of {symbol}", float(envelope["r"]), R_LIMIT, "≤", "", True, meaning)
        end = f"{prefix}.terminal"
        if task.attitude_sigma or task.rate_sigma:
            meaning = f"{FLOOR:g}σ of the noise in the errors that the law gets: an envelope below "
            meaning += "it is left by noise alone"
            yield Condition(end, law[end], FLOOR * sigma, "≥", unit, False, meaning)
        actuator = ACTUATORS.selected(plant)
        if prefix == RATE_ENVELOPE.name and actuator and actuator.least_impulse:
            inertia = inertia_matrix(INERTIA.name, law[INERTIA.name])
            changes = np.linalg.solve(inertia, actuator.least_impulse(plant).T)  # [rad/s] body
            change = float(np.abs(changes).max(initial=0.0)) * _first_answer(scenario, task.craft)
            meaning = f"{_PULSES:g} times the rate that the largest of the least pulses makes "
            meaning += "before modes follow: an envelope below it is left by single pulses"
            name = f"least pulse in {symbol}"
            yield Condition(name, law[end], _PULSES * change, "≥", unit, False, meaning)


def _of_actuator(scenario: Scenario, task: Task) -> Iterator[Condition]:
    """Compare what the actuator gives with the environment, and with the law's limit."""
    meaning = "the torque of the actuator without faults, on every axis, exceeds the largest norm "
    meaning += "of the environment's torque"
    yield Condition("torque authority", task.torque, task.environment, ">", "N·m", False, meaning)
    actuator = ACTUATORS.selected(scenario.parameters[PLANT])
    if actuator is not None and actuator.torque is not None:
        yield advisable(
            MAX_TORQUE.name,
            scenario.number(CONTROLLER, MAX_TORQUE.name),
            task.actuator_torque,
            "N·m",
            "the actuator without faults gives the torque limit of the law on all axes at once; "
            "friction and gyroscopic torque may take a little of it",
        )


def _of_knowledge(scenario: Scenario, task: Task) -> Iterator[Condition]:
    """Compare the craft with what its law knows of it."""
    if INERTIA.name in task.craft:
        known, true = scenario.parameters[CONTROLLER][INERTIA.name], task.craft[INERTIA.name]
        meaning = "relative error of the law's inertia about the worst axis"
        error = inertia_error(np.array(known), np.array(true))
        yield advisable("inertia", error, _INERTIA_ERROR, "", meaning)
    plant, estimator = scenario.parameters[PLANT], scenario.parameters[ESTIMATOR]
    senses = SENSORS.selected(plant) is gyro_star_tracker.COMPONENT
    wrong = np.linalg.norm(gyro.gyro_record(plant)["response"] - np.eye(3), 2) if senses else 0.0
    if wrong and ESTIMATORS.selected(estimator) is mekf.COMPONENT:
        start = np.linalg.norm(task.craft.get(INITIAL_RATE.name, 0.0))
        fastest = max(task.desired_rate or 0.0, float(start))
        moved = wrong * fastest * bias_in_innovation(estimator, scenario.number(PLANT, "rate"))
        meaning = "how far the gyro's errors of scale and axes take a fix from its prediction at "
        meaning += f"most, at {fastest:.3g} rad/s and in σ of the innovation: the filter takes "
        meaning += "them for a bias, which then changes faster than its gyro.rate_random_walk says"
        yield advisable("gyro scale and axes", float(moved), 1.0, "", meaning)


def _of_pulses(scenario: Scenario, required: Requirements, task: Task) -> Iterator[Condition]:
    """How long the actuator needs at best to take back what each scheduled pulse gives."""
    rate = scenario.number(PLANT, "rate")
    for hit in scheduled_pulses(scenario.parameters[INJECTOR]):
        start_ns, end_ns = int(hit["start_ns"]), int(hit["end_ns"])
        acts = (first_step(end_ns, rate) - first_step(start_ns, rate)) / rate
        yield advisable(
            f"pulse at {instant(seconds(start_ns))} s",
            float(np.abs(hit["torque"]).max()) * acts / task.torque,
            required.recovery,
            "s",
            "the time in which the actuator can remove the pulse's momentum, against the time "
            "allowed for the recovery",
        )
