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

"""Conditions of `check`: wishes and settings must be in proportion to the craft."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ppc_attitude.analysis.requirements import Requirements
from ppc_attitude.contract.declared import has_parameter
from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import CONTROLLER, ESTIMATOR, INJECTOR, PLANT, REFERENCE
from ppc_attitude.science.actuators import ideal
from ppc_attitude.science.attitude import conjugate, logarithm, product
from ppc_attitude.science.certificate import Condition, virtual_control_bound
from ppc_attitude.science.controllers import ppc, quaternion_feedback
from ppc_attitude.science.controllers.common import MAX_TORQUE, envelope_of, envelopes_of
from ppc_attitude.science.disturbances.pulses import scheduled_pulses
from ppc_attitude.science.envelope_plan import least_settling_time
from ppc_attitude.science.estimators import mekf
from ppc_attitude.science.estimators.steady_state import FLOOR, Sigmas, error_sigmas, noise_floors
from ppc_attitude.science.guidance.orders import GOAL_FRAMES, GOAL_TIMES
from ppc_attitude.science.guidance.profile import duration, profile
from ppc_attitude.science.guidance.slew import slew_torque
from ppc_attitude.science.inertia import inertia_error, inertia_matrix
from ppc_attitude.science.kinds import ACTUATORS, ESTIMATORS, PLANTS, REFERENCES, SENSORS
from ppc_attitude.science.multibody import COUPLING
from ppc_attitude.science.performance import nominal
from ppc_attitude.science.plants.rigid_body import INERTIA, INITIAL_RATE
from ppc_attitude.science.references import goal
from ppc_attitude.science.sensors import direct, gyro_star_tracker
from ppc_attitude.science.sensors.star_tracker import CROSS_NOISE, MOUNTING, unit_mounting
from ppc_attitude.science.stamps import NANOSECONDS
from ppc_attitude.science.thrusters import PERIOD
from ppc_attitude.simulation.scenario import Scenario

_DEAD_SHARE = 0.1  # of the actuator that its dead zone may take
_PULSES = 3.0  # least pulses that should have room in the rate envelope
_INERTIA_ERROR = 0.3  # docs/guarantee.md has measured it
_NOISE_SIGMAS = 3.0  # of what noise makes a law ask for, that the actuator should give
_WORSE = 3.0  # how many times its noise, or σ its mounting, a sensor may be off a filter's number


def _at_most(name: str, value: float, limit: float, unit: str, meaning: str) -> Condition:
    """Condition that may be violated, with a warning: it is advice."""
    return Condition(name, value, limit, "≤", unit, False, meaning)


def settling_conditions(
    scenario: Scenario, required: Requirements, q_e: tuple[float, float, float, float]
) -> Iterator[Condition]:
    """The least time to settle, for the actuator and for the law, and the time that is left.

    It settles from the attitude error q_e, x y z w, at the start.
    """
    if not has_parameter(PLANT, scenario.parameters[PLANT], INERTIA.name):
        return
    component, whole = required.settled.bounds
    error = np.abs(q_e[:3])
    if error.max() <= component and np.linalg.norm(error) <= whole:
        return
    angle = 2.0 * math.asin(min(float(np.linalg.norm(error)), 1.0))
    asked = required.settling_deadline
    wish = f"an error of {required.settled} from rest at {math.degrees(angle):.4g}°"

    def condition(name: str, needs: float, who: str) -> Condition:
        rest = asked - needs
        left = f"which leaves {rest:.3g} s" if rest >= 0.0 else f"which is {-rest:.3g} s too few"
        meaning = f"{wish} needs {needs:.3g} s at best {who}; you ask {asked:g} s, {left}"
        if math.isinf(needs):
            meaning = f"{wish} is not reached within an hour {who}; you ask {asked:g} s"
        return Condition(name, needs, asked, "≤", "s", True, meaning)

    yield condition(
        "time to turn",
        _least_turn(scenario, required, np.array(q_e[:3]), angle),
        f"with {acting_torque(scenario):.3g} N·m on an axis"
        f"{f' and within {required.rate:g} deg/s' if required.rate else ''}",
    )
    if scenario.controller.name == ppc.COMPONENT.name:
        gains = ppc.configure(scenario.parameters[CONTROLLER])
        needs = float(least_settling_time(q_e, component, whole, gains))
        yield condition("time of the law", needs, "with the law's k, M_omega and beta")


def _least_turn(scenario: Scenario, required: Requirements, error: Array, angle: float) -> float:
    """Least time [s] about the eigenaxis, rest to rest, to where the error is small enough."""
    axis = error / np.linalg.norm(error)
    component, whole = required.settled.bounds
    near = min(component / np.abs(axis).max(), whole, 1.0)
    inertia = inertia_matrix("inertia", scenario.parameters[PLANT]["inertia"])
    acceleration = acting_torque(scenario) / np.abs(inertia @ axis).max()
    rate = math.radians(required.rate) if required.rate else math.inf
    turn = max(angle - 2.0 * math.asin(near), 0.0)
    return float(duration(profile(turn, rate, float(acceleration), math.inf)))


def slew_conditions(scenario: Scenario, required: Requirements) -> Iterator[Condition]:
    """The needs of a slew: of the actuator's torque, and of the rate that the craft may have."""
    reference = scenario.parameters[REFERENCE]
    if REFERENCES.selected(reference) is not goal.COMPONENT:
        return
    plant = scenario.parameters[PLANT]
    rate, acceleration, share = (
        reference[each.name] for each in (goal.MAX_RATE, goal.MAX_ACCELERATION, goal.TORQUE_SHARE)
    )
    spins = "spin" in reference[GOAL_FRAMES.name]
    # In a frame that turns by ω_f a slew is accelerated by ω × ω_f too; a spin may be nearly as
    # fast as V.
    crossed = rate * abs(reference[goal.SPIN_RATE.name]) if spins else 0.0
    if has_parameter(PLANT, plant, INERTIA.name):
        yield _at_most(
            "slew torque",
            slew_torque(np.reshape(plant["inertia"], (3, 3)), rate, acceleration + crossed),
            share * acting_torque(scenario),
            "N·m",
            f"max‖J e‖ {'(A + V |spin.rate|)' if spins else 'A'} + max‖ω × J ω‖ leaves the law its "
            "margin (guidance.torque_share)",
        )
    times = reference[GOAL_TIMES.name]
    end = scenario.number(PLANT, "duration")
    if times and end:
        yield _at_most("last goal", max(times), end, "s", "all goals begin before the run ends")
    law = scenario.parameters[CONTROLLER]
    if scenario.controller.name == ppc.COMPONENT.name and required.rate is not None:
        yield _rate_of_slew(rate, times, law, required.rate)


def _rate_of_slew(
    rate: float, times: Sequence[float], law: Mapping[str, Any], limit: float
) -> Condition:
    """The largest rate during a slew: V, and what the law `ppc` adds for an error."""
    shape = envelope_of("attitude_envelope", law).shape()
    begin = min(times, default=math.inf)
    width = min(nominal(begin, shape)[0], 1.0) if times else float(shape["terminal"])
    when = f"of the first goal, t = {begin:g} s" if times else "once settled"
    return _at_most(
        "slew rate",
        math.degrees(rate + virtual_control_bound(law) * width),
        limit,
        "deg/s",
        f"V + max‖v‖ ρ_q, ρ_q = {width:.3g} {when}: an error as large as its envelope would add so "
        "much",
    )


def actuator_torque(scenario: Scenario) -> float:
    """Torque per axis [N·m] that the selected actuator gives in any direction.

    Of one that does not tell it is what the law may ask for.
    """
    plant = scenario.parameters[PLANT]
    actuator = ACTUATORS.selected(plant)
    torques = actuator.torques(plant) if actuator else None
    return torques[0] if torques else scenario.number(CONTROLLER, "max_torque")


def acting_torque(scenario: Scenario) -> float:
    """Torque per axis [N·m] that acts at most: the law asks for no more than its limit."""
    return min(scenario.number(CONTROLLER, MAX_TORQUE.name), actuator_torque(scenario))


def actuator_conditions(scenario: Scenario) -> Iterator[Condition]:
    """Compare what the actuator gives, and its dead zone, with what the law asks for."""
    plant = scenario.parameters[PLANT]
    actuator = ACTUATORS.selected(plant)
    if actuator is not None and actuator.torque is not None:
        yield _at_most(
            "max_torque",
            scenario.number(CONTROLLER, "max_torque"),
            actuator_torque(scenario),
            "N·m",
            "the actuator gives what the law may ask for, on all axes at once; friction and "
            "gyroscopic torque of wheels take a little of it",
        )
    if actuator is not None and actuator.least_impulse is not None:
        yield from _pulse_conditions(actuator.least_impulse(plant), scenario)
    if actuator is not ideal.COMPONENT:
        return
    dead = scenario.number(PLANT, "min_torque")
    yield _at_most(
        "min_torque",
        dead,
        _DEAD_SHARE * scenario.number(PLANT, "max_torque"),
        "N·m",
        f"the dead zone takes at most {100.0 * _DEAD_SHARE:g} % of the actuator",
    )
    if scenario.controller.name == ppc.COMPONENT.name:
        law = scenario.parameters[CONTROLLER]
        yield _at_most(
            "min_torque in ρ_ω",
            dead,
            law["K_omega"] * _moments(law)[0] * law["rate_envelope.terminal"],
            "N·m",
            "K_ω J g∞: at the edge of the rate envelope the law asks for more than the dead zone, "
            "so that the actuator acts inside it",
        )


def _pulse_conditions(impulse: float, scenario: Scenario) -> Iterator[Condition]:
    """Compare what the least pulse [N·m·s] of an actuator does with the law's rate envelope."""
    if "rate_envelope" in envelopes_of(scenario.controller):
        law = scenario.parameters[CONTROLLER]
        yield Condition(
            "least pulse in ρ_ω",
            law["rate_envelope.terminal"],
            _PULSES * impulse / _moments(law)[0] * _first_answer(scenario),
            "≥",
            "rad/s",
            False,
            f"{_PULSES:g} times the rate that the actuator's least pulse makes, before modes "
            "follow: below it, single pulses leave the envelope",
        )


def knowledge_conditions(scenario: Scenario) -> Iterator[Condition]:
    """Compare the craft with what its law knows of it, and its rates with those of its tracker."""
    plant = scenario.parameters[PLANT]
    if has_parameter(PLANT, plant, INERTIA.name):
        known = scenario.parameters[CONTROLLER][INERTIA.name]
        yield _at_most(
            "inertia",
            inertia_error(np.array(known), np.array(plant[INERTIA.name])),
            _INERTIA_ERROR,
            "",
            "by how much of itself the inertia that the law knows is off, about the worst axis",
        )
    if SENSORS.selected(plant) is not gyro_star_tracker.COMPONENT:
        return
    estimator = scenario.parameters[ESTIMATOR]
    if ESTIMATORS.selected(estimator) is mekf.COMPONENT:
        yield from _beliefs(plant, estimator)
    most = plant["star_tracker.max_rate"]
    if has_parameter(PLANT, plant, INITIAL_RATE.name):
        yield _at_most(
            "rate at the start",
            float(np.linalg.norm(plant[INITIAL_RATE.name])),
            most,
            "rad/s",
            "up to star_tracker.max_rate a first fix comes: without one there is no estimate, so "
            "the law gives no torque, and nothing stops the craft",
        )
    reference = scenario.parameters[REFERENCE]
    if REFERENCES.selected(reference) is goal.COMPONENT:
        yield _at_most(
            "rate of a slew",
            reference[goal.MAX_RATE.name],
            most,
            "rad/s",
            "fixes come while guidance.max_rate is at most star_tracker.max_rate: in a faster slew "
            "only the gyro tells the attitude",
        )


def _beliefs(plant: Mapping[str, Any], estimator: Mapping[str, Any]) -> Iterator[Condition]:
    """Compare the sensors with what the filter takes them for, where these are not the same."""
    for each in mekf.PARAMETERS:
        true, taken = plant.get(each.name), estimator[each.name]
        if true in (None, taken):
            continue
        both = f"{each.name} = {_short(true)} of {PLANT}, {_short(taken)} of {ESTIMATOR}: "
        if each is MOUNTING:
            turn = product(conjugate(unit_mounting(plant)), unit_mounting(estimator))
            angle = float(np.linalg.norm(logarithm(turn)))
            most = _WORSE * estimator[CROSS_NOISE.name]
            meaning = (
                f"{both}a fix is off by less than {_WORSE:g}σ of its noise across the boresight"
            )
            yield _at_most(each.name, angle, most, "rad", meaning)
        else:
            ratio = true / taken if taken else math.inf
            meaning = f"{both}the sensor is not much worse than the filter takes it for"
            yield _at_most(each.name, ratio, _WORSE, "", meaning)


def _short(value: float | Sequence[float]) -> str:
    """Write a number, or numbers, for a reader."""
    if isinstance(value, Sequence):
        return f"[{', '.join(map(_short, value))}]"
    return f"{value:g}"


def sampling_conditions(scenario: Scenario) -> Iterator[Condition]:
    """Compare how the laws `ppc` and `quaternion_feedback` answer an error with a sample's time."""
    if scenario.controller.name == quaternion_feedback.COMPONENT.name:
        yield from _linear_conditions(scenario)
    if scenario.controller.name == ppc.COMPONENT.name:
        law = scenario.parameters[CONTROLLER]
        width = law["rate_envelope.terminal"]
        h, first = _held(scenario), _first_answer(scenario)
        change = law["D_m"] * h / _moments(law)[0] * first
        yield _at_most(
            "answer to z2",
            law["K_omega"] * h * first + change / law["mu"] / width,
            2.0,
            "",
            "K_ω h + D_m h / (J μ g∞), h a step or the thrusters' period, more where modes "
            "follow later: the torque does not throw a small rate error farther to the other side; "
            "beyond it the torque may change its sign at every sample",
        )
        yield _at_most(
            "D_m in ρ_ω",
            0.5 * change,
            width,
            "rad/s",
            "D_m h / 2J: if the disturbance estimate changes sign at every sample, the rate error "
            "stays inside its envelope",
        )


def _linear_conditions(scenario: Scenario) -> Iterator[Condition]:
    """Stability of φ'' = −2ζω φ' − ω² (φ + ∫φ dt / T), by Jury where sampled, and by Routh."""
    law = scenario.parameters[CONTROLLER]
    frequency, damping, time = (law[each.name] for each in quaternion_feedback.LOOP)
    cubic = (1.0, 2.0 * damping * frequency, frequency**2, frequency**2 / time)
    slowest = float(np.roots(cubic).real.max())
    yield _at_most(
        "loop against sampling",
        frequency * _held(scenario),
        min(1.0 / damping / _first_answer(scenario), 4.0 * damping),
        "",
        "ω_n h ≤ min(1/ζ, 4ζ), h a step or the thrusters' period, less where modes follow "
        "later: the sampled loop is stable, if rates are exact and commands act at once; beyond it "
        "the torque changes its sign at every sample, or swings",
    )
    yield _at_most(
        "integral of the loop",
        1.0 / time,
        2.0 * damping * frequency,
        "1/s",
        "1/T ≤ 2ζω_n: the integral does not make the loop swing; the slowest part of a small error "
        f"{'never fades' if slowest >= 0.0 else f'is 1/e after {-1.0 / slowest:.3g} s'}",
    )


def _moments(law: Mapping[str, Any]) -> list[float]:
    """Principal moments [kg·m²] of the inertia that the law knows, ascending."""
    moments: list[float] = np.linalg.eigvalsh(inertia_matrix("inertia", law["inertia"])).tolist()
    return moments


def _held(scenario: Scenario) -> float:
    """Time [s] for which the law's answer to an error holds: a step, or a period of thrusters."""
    plant = scenario.parameters[PLANT]
    if has_parameter(PLANT, plant, PERIOD.name):
        return float(plant[PERIOD.name])
    return 1.0 / scenario.number(PLANT, "rate")


def _first_answer(scenario: Scenario) -> float:
    """How many times the acceleration that a law counts on a torque gives at first, at most.

    It moves J − Σ J_s a aᵀ − δᵀδ, and flexible modes follow later; without modes it is 1.
    """
    plant = scenario.parameters[PLANT]
    if not (has_parameter(PLANT, plant, COUPLING.name) and plant[COUPLING.name]):
        return 1.0
    known = inertia_matrix("inertia", scenario.parameters[CONTROLLER]["inertia"])
    inverse = PLANTS.components[plant["plant"]].configure(plant)["body"]["inertia_inverse"]
    return float(np.linalg.eigvals(inverse @ known).real.max())


def noise_conditions(scenario: Scenario) -> Iterator[Condition]:
    """How wide noise lets the ends of the envelopes be, and how much torque it asks for."""
    sigmas = _sigmas(scenario)
    if not any(sigmas):
        return
    law = scenario.parameters[CONTROLLER]
    bounded = envelopes_of(scenario.controller)
    for prefix, sigma, unit in (
        ("attitude_envelope", sigmas.attitude, ""),
        ("rate_envelope", sigmas.rate, "rad/s"),
    ):
        if prefix in bounded:
            yield Condition(
                f"{prefix}.terminal",
                law[f"{prefix}.terminal"],
                FLOOR * sigma,
                "≥",
                unit,
                False,
                f"{FLOOR:g}σ of the noise in what the law is told: below it, noise alone leaves "
                "the envelope",
            )
    if scenario.controller.name == ppc.COMPONENT.name:
        yield _at_most(
            "noise torque",
            _NOISE_SIGMAS * law["K_omega"] * _moments(law)[-1] * sigmas.rate,
            actuator_torque(scenario),
            "N·m",
            f"{_NOISE_SIGMAS:g}σ of K_ω J z2: the actuator gives what noise makes the law ask for",
        )


def _sigmas(scenario: Scenario) -> Sigmas:
    """σ of the errors as the law sees them, on the axis on which it is largest.

    Nobody knows those of an estimator or of sensors of somebody else's: zeros.
    """
    plant, estimator, law = (scenario.parameters[each] for each in (PLANT, ESTIMATOR, CONTROLLER))
    rate = scenario.number(PLANT, "rate")
    selected = ESTIMATORS.selected(estimator)
    if selected is mekf.COMPONENT:
        return Sigmas(*map(max, *noise_floors(estimator, law, rate)))
    if selected is None and SENSORS.selected(plant) is direct.COMPONENT:
        white = plant["rate_noise"] / math.sqrt(rate)
        return error_sigmas(law, rate, white, plant["attitude_noise"] ** 2, 0.0)
    return Sigmas(0.0, 0.0)


def pulse_conditions(scenario: Scenario, required: Requirements) -> Iterator[Condition]:
    """How long the actuator needs at best to take back what each scheduled pulse gives."""
    torque = acting_torque(scenario)
    for hit in scheduled_pulses(scenario.parameters[INJECTOR]):
        start, end = (int(hit[each]) / NANOSECONDS for each in ("start_ns", "end_ns"))
        yield _at_most(
            f"pulse at {start:g} s",
            float(np.abs(hit["torque"]).max()) * (end - start) / torque,
            required.recovery,
            "s",
            "time in which the actuator alone takes back the pulse's momentum, against the "
            "required recovery",
        )
