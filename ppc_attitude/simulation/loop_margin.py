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

"""How far the closed loop is from oscillating, measured on the loop itself.

Craft and reference are at rest, without noise, stiction, faults and disturbances: there the gain of
a law with tanh is largest. A small torque d acts for one sample, and the actuator answers with the
torque u. The torque is as large as it can be while the answers to d and −d/2 are in proportion,
because the rounding of attitudes hides the answer to a smaller one. To first order S = I + U/D is
the sensitivity at the craft, whatever is in the loop: law, observer, filter, delays, wheels, modes.
The disk margin is α = 1/‖S − I/2‖∞ (Seiler, Packard and Gahinet, *An introduction to disk margins*,
2020): the loop stays stable if the gain of every axis changes by a factor between (2 − α)/(2 + α)
and its inverse, or the phase of every axis by up to 2 atan(α/2), each axis in its own way.

For an actuator that acts in pulses, once in a period, a sample is a period, and torques are its
means.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.contract.declared import parameters_in_use
from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import CONTROLLER, INJECTOR, NODE_OF, PLANT
from ppc_attitude.science.conditions import Condition, advisable
from ppc_attitude.science.controllers.common import envelopes_of
from ppc_attitude.science.disturbances.pulses import DURATIONS, TIMES, TORQUES
from ppc_attitude.science.faults import FAULTS
from ppc_attitude.science.kinds import ACTUATORS, DISTURBANCES, ENVIRONMENTS
from ppc_attitude.science.plants.rigid_body import INITIAL_ATTITUDE, INITIAL_RATE
from ppc_attitude.science.signals import APPLIED_TORQUE, REFERENCE_ATTITUDE, REFERENCE_RATE
from ppc_attitude.science.stamps import stamp_of
from ppc_attitude.simulation.closed_loop import first_instant
from ppc_attitude.simulation.diagram import Diagram, selected
from ppc_attitude.simulation.scenario import Scenario

LEAST = 0.3
"""Disk margin that a loop should have: its gain may change by 1.35 times, or its phase by 17°."""
_SWING = 0.01  # share of the actuator's torque that may swing by itself
_LATEST = 3600.0  # [s] at which the loop is measured
_SHARES = (1e-3, 1e-5, 1e-7)  # of the actuator's torque: the first that is small in the envelopes
_FADED = 0.01  # share of the largest answer that is as good as none
_UNHEARD = 0.05  # of S, which the rest of an answer may change
_ROUNDING = 1e-6  # share of an answer, and of the actuator's torque, that rounding may make
_LINEAR = 0.05  # share by which the answers to d and −d/2 may differ
_LEFT = 0.5  # share of a lasting torque that the loop may leave
_FIRST, _LONGEST, _MOST = 60.0, 3840.0, 250_000  # [s], [s] and instants of an answer
_LAGS = (1, 2, 4)  # [samples] after which a torque that swings has the other sign
_BLOCK = 4096  # instants of which the samples are not kept


@dataclass(frozen=True)
class LoopMargin:
    """What a loop at rest bears.

    Attributes
    ----------
    disk : float
        Disk margin α; 0 if the loop does not come to rest after a small torque while one listens.
    frequency : float
        Where it is least, or where the loop swings [Hz].
    fades : float
        Time [s] after which the answer to a small torque is below 1 % of its largest value; for how
        long it was listened to if `disk` is 0.
    swing : float
        Amplitude with which the torque of an axis still swings, within some samples, long after a
        small torque [N·m]; infinite if a torque is not finite.
    """

    disk: float
    frequency: float
    fades: float
    swing: float

    @property
    def gain(self) -> float:
        """Factor by which the gain of each axis may grow or fall."""
        return (2.0 + self.disk) / (2.0 - self.disk) if self.disk < 2.0 else math.inf

    @property
    def phase(self) -> float:
        """Angle [deg] by which the phase of each axis may change."""
        return 2.0 * math.degrees(math.atan(0.5 * self.disk))


def loop_conditions(scenario: Scenario, at: float, torque: float) -> Iterator[Condition]:
    """Compare what the loop bears with what it should bear, when its envelopes are at their end.

    That is at a time [s] or later. Parameters are those of `loop_margin`.
    """
    law = scenario.parameters[CONTROLLER]
    ends = (law[f"{each}.settling_time"] for each in envelopes_of(scenario.controller))
    at = min(max(at, *ends, 0.0), _LATEST)
    found = loop_margin(scenario, at, torque)
    where = f"{found.frequency:.3g} Hz"
    meaning = f"disk margin: at rest, at {at:g} s and without noise, rounding, dead zone, shortest "
    meaning += "pulses, stiction, disturbance and faults, "
    if found.disk:
        meaning += (
            f"the loop stays stable if the gain of each axis changes by up to {found.gain:.3g} "
            f"times, or its phase by up to {found.phase:.3g}°; least at {where}; the answer to a "
            f"small torque fades within {found.fades:.3g} s"
        )
    else:
        meaning += (
            f"the loop swings, or the answer to a small torque grows, has not faded after "
            f"{found.fades:.3g} s, is not in proportion to it, or does not come; it is largest at "
            f"{where}"
        )
    yield Condition("loop margin", found.disk, LEAST, "≥", "", False, meaning)
    yield advisable(
        "torque at rest",
        found.swing,
        _SWING * torque,
        "N·m",
        f"amplitude with which the torque of an axis goes on swinging, with a period of "
        f"{2 * _LAGS[0]} to {2 * _LAGS[-1]} samples, or periods of thrusters, against "
        f"{100.0 * _SWING:g} % of what the actuator gives at most",
    )


def loop_margin(scenario: Scenario, at: float, torque: float) -> LoopMargin:
    """Measure what the loop bears at a time [s]; its actuator gives a torque [N·m] at most.

    Raises
    ------
    ConfigurationError
        A parameter is infeasible, or the selected components do not fit together.
    """
    loop, swing = _RestingLoop(scenario, at), 0.0
    for share in _SHARES:
        heard = _listened(loop, share * torque)
        swing = max(swing, heard.swing)
        if heard.proportional:
            break
    samples = len(heard.answer)
    if not np.isfinite(heard.answer).all():
        return LoopMargin(0.0, 0.0, samples * loop.sample, math.inf)
    sensitivity = np.eye(3) + np.fft.rfft(heard.answer, 4 * samples, axis=0)
    holds = np.linalg.norm(sensitivity[0], 2) <= _LEFT
    rests = heard.rests and swing <= _SWING * torque  # else the answer is that of a swing
    known = bool(heard.proportional and rests and holds)
    sizes = np.linalg.norm(sensitivity - 0.5 * np.eye(3), 2, axis=(1, 2))
    worst = int(sizes.argmax())
    return LoopMargin(
        disk=1.0 / float(sizes[worst]) if known else 0.0,
        frequency=0.25 * worst / (samples * loop.sample),
        fades=(heard.fades if known else samples) * loop.sample,
        swing=swing if swing > _ROUNDING * torque else 0.0,
    )


class _Heard(NamedTuple):
    """What was heard of a loop."""

    swing: float  # amplitude [N·m] with which the torque still swings in the end
    answer: Array  # U/D, shape (samples, 3, 3)
    proportional: bool  # whether the answer is the same to pushes of two sizes and signs
    fades: int  # samples until it is small
    rests: bool  # whether it has faded


def _listened(loop: "_RestingLoop", push: float) -> _Heard:
    """Push [N·m] the craft about each axis, and listen until the answer has faded."""
    listened, pushes = _FIRST, (push, -0.5 * push)
    while True:
        samples = loop.samples(listened)
        alone = loop.answer(samples, np.zeros(3))
        pushed = [
            np.stack([loop.answer(samples, row) for row in each * np.eye(3)], axis=2)
            for each in pushes
        ]
        once, back = (
            (torque - alone[..., None]) / each for torque, each in zip(pushed, pushes, strict=True)
        )
        answer = (once + 2.0 * back) / 3.0
        proportional = bool(np.abs(once - back).max() <= _LINEAR * np.abs(answer).max())
        swing = _swing(pushed[0][-max(samples // 4, 2 * _LAGS[-1] + 1) :])
        heard = _Heard(swing, answer, proportional, *_faded(answer))
        listened *= 2.0
        heard_all = listened > _LONGEST or loop.samples(listened) == samples
        if heard.rests or heard_all or not proportional:
            return heard


def _faded(answer: Array) -> tuple[int, bool]:
    """After how many samples an answer is small, and whether what is still to come is, too."""
    sizes = np.abs(answer).max(axis=(1, 2))
    large = np.flatnonzero(sizes > _FADED * sizes.max())
    fades = int(large.max(initial=0)) + 1
    # A mode that fades slowly, or grows, may long be far below the first answer.
    quarters = np.array_split(answer, 4)
    whole, before, end = (float(np.linalg.norm(each)) for each in (answer, *quarters[-2:]))
    to_come = end / (before - end) if end < before else math.inf  # quarters as large as the end
    unheard = float(np.abs(quarters[-1]).sum(axis=0).max()) * to_come
    return fades, fades < 0.9 * len(answer) and (unheard < _UNHEARD or end < _ROUNDING * whole)


def _swing(torque: Array) -> float:
    """Amplitude [N·m] with which a torque, its samples first, changes its sign after some lag."""
    changes = (torque[2 * n :] - 2.0 * torque[n:-n] + torque[: -2 * n] for n in _LAGS)
    return max(0.25 * float(np.abs(each).max()) for each in changes)


class _RestingLoop:
    """The loop of a scenario, at rest at a time [s], to which a torque is added.

    `sample` is the time [s] between two answers.
    """

    def __init__(self, scenario: Scenario, at: float) -> None:
        quiet = _at_rest(scenario)
        self._rate, plant = quiet.number(PLANT, "rate"), quiet.parameters[PLANT]
        actuator = ACTUATORS.selected(plant)
        period = actuator.period(plant) if actuator else 0.0
        self._steps = max(round(min(period * self._rate, _MOST)), 1)  # of a sample
        self.sample = self._steps / self._rate
        self._first = math.ceil(at / self.sample) * self._steps
        self._diagram = Diagram(quiet.parameters)
        for start in range(0, self._first, _BLOCK):
            end = min(start + _BLOCK, self._first)
            self._diagram.run(_stamps(start, end, self._rate))
        self._rest = self._diagram.snapshot()
        self._heard = dict[tuple[float, ...], tuple[list[Array], list[NDArray[Any]]]]()

    def samples(self, listened: float) -> int:
        """How many answers come in a time [s]."""
        return max(min(round(listened / self.sample), _MOST // self._steps), 2 * _LAGS[-1] + 1)

    def answer(self, samples: int, push: Array) -> Array:
        """Torque [N·m] in each sample from a push [N·m] of one sample on, shape (samples, 3)."""
        diagram, first = self._diagram, self._first
        heard, since = self._heard.get(tuple(push), ([], self._rest))
        diagram.put_back(since)
        pulse = ([first / self._rate], [self.sample], push.tolist())
        pulses = zip((TIMES.name, DURATIONS.name, TORQUES.name), pulse, strict=True)
        diagram.parts[DISTURBANCES.name].configure(dict(pulses))
        rows = diagram.rows[APPLIED_TORQUE.name]
        end, first = first + samples * self._steps, first + sum(map(len, heard))
        for start in range(first, end, _BLOCK):
            stamps = _stamps(start, min(start + _BLOCK, end), self._rate)
            heard.append(diagram.run(stamps)[rows].T.copy())  # not a view of all columns
        self._heard[tuple(push)] = heard, diagram.snapshot()
        torque = np.concatenate(heard)[: samples * self._steps]
        return np.asarray(torque.reshape(samples, self._steps, 3).mean(axis=1))


@lru_cache(maxsize=128)  # every answer begins with the same
def _stamps(first: int, end: int, rate: float) -> NDArray[np.int64]:
    return np.array([stamp_of(k, rate) for k in range(first, end)], np.int64)


def _at_rest(scenario: Scenario) -> Scenario:
    """The craft at rest on its reference, with nothing that disturbs the answer to a torque."""
    chosen, injector = selected(scenario.parameters), scenario.parameters[INJECTOR]
    quiet: dict[str, dict[str, object]] = {PLANT: {}, INJECTOR: {}}
    for kind, component in chosen:
        quiet.setdefault(NODE_OF[kind.name], {}).update(component.quiet)
    quiet[INJECTOR].update((each.name, []) for each in (TIMES, DURATIONS, TORQUES))
    read = {each for kind, part in chosen if kind is not DISTURBANCES for each in part.inputs}
    environment = ENVIRONMENTS.selected(injector)
    if environment is not None and read.isdisjoint(environment.outputs):
        quiet[INJECTOR][ENVIRONMENTS.selector] = ENVIRONMENTS.switch[False]
    in_use = parameters_in_use(PLANT, scenario.parameters[PLANT])
    if FAULTS.name in in_use:
        quiet[PLANT][FAULTS.name] = []
    resting = scenario.overlaid(quiet)
    if not {INITIAL_ATTITUDE.name, INITIAL_RATE.name} <= in_use.keys():
        return resting
    parts = first_instant(resting).values()
    given = {name: part.output(name) for part in parts for name in part.places}
    motion = (INITIAL_ATTITUDE, REFERENCE_ATTITUDE), (INITIAL_RATE, REFERENCE_RATE)
    start = {initial.name: list(given[desired.name]) for initial, desired in motion}
    return resting.overlaid({PLANT: start})
