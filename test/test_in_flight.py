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

"""Every parameter that can be set in flight acts in flight; set there and back, it does nothing."""

from collections.abc import Iterator
from typing import Any

from craft_helpers import configs

from ppc_attitude.contract.topics import (
    ALLOCATOR,
    CONTROLLER,
    INJECTOR,
    NODE_OF,
    PLANT,
    REFERENCE,
)
from ppc_attitude.science import rate_observer, wheels
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kinds import KINDS, PLANTS, Kind
from ppc_attitude.science.parameter import Parameter, Value
from ppc_attitude.simulation.closed_loop import stamps_of
from ppc_attitude.simulation.diagram import Diagram, selected
from ppc_attitude.simulation.scenario import load

SET, SHOWN = 3.0, 8.0  # [s] when a parameter is set, and by when it must have acted
STILL, HALF = [0.0, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0]
NEAR = {"initial_attitude": [0.2, -0.5, -0.5, -0.6782]}
NOISY = {"attitude_noise": 1e-4, "rate_noise": 1e-4}
OBSERVED = {"rate_observer": 2.0, "disturbance_feedforward": True, "max_disturbance": 0.01}
PULSE = {"pulse_times": [2.0], "pulse_durations": [2.0], "pulse_torques": [0.2, -0.2, 0.2]}
LOST = {"star_tracker.outlier_probability": 0.5, "star_tracker.outlier_size": 0.1}
WHEELS = {
    "wheels.initial_speed": [300.0],
    "wheels.max_torque": [0.02],
    "wheels.stribeck_speed": [300.0],
    "faults": ["wheel/0 effectiveness 0 from 4"],
}
DRIVEN, SENT = {PLANT: WHEELS}, {PLANT: WHEELS, ALLOCATOR: WHEELS}
GOALS = {
    "goals.times": [0.0, 4.0],
    "goals.frames": ["spin", "spin"],
    "goals.attitudes": STILL + HALF,
    "keep_out.directions": ["-1 0 0"],
    "keep_out.axes": [0.0, 0.0, 1.0],
    "keep_out.half_angles": [1.5],
}
EARLY = {
    "attitude_envelope.settling_time": 4.0,
    "attitude_envelope.decay": 1.0,
    "rate_envelope.settling_time": 4.0,
    "rate_envelope.exponential_terminal": 0.01,
    "rate_envelope.terminal": 0.01,
}
CASES: dict[str, tuple[tuple[str, ...], dict[str, dict[str, Any]]]] = {
    "noise": (("paper",), {PLANT: NOISY, CONTROLLER: OBSERVED, INJECTOR: PULSE}),
    "near": (("paper",), {PLANT: NEAR, CONTROLLER: {"controller": "quaternion_feedback"}}),
    "turned over": (("paper", "any_start"), {PLANT: {"initial_attitude": HALF}}),
    "settled": (("paper",), {CONTROLLER: EARLY, INJECTOR: PULSE}),
    "barrier": (("paper", "traditional"), {PLANT: NOISY, CONTROLLER: OBSERVED | EARLY}),
    "linear": (
        ("paper",),
        {
            PLANT: NOISY,
            CONTROLLER: {**OBSERVED, "controller": "quaternion_feedback"},
            INJECTOR: PULSE,
        },
    ),
    "tube": (("paper", "guaranteed"), {}),
    "tube ahead": (("paper", "guaranteed_ahead"), {}),
    "sensors": (("paper", "sensors_cubesat"), {PLANT: LOST}),
    "flexible": (("paper", "flexible"), {}),
    "wheels": (("paper", "flexible", "wheels", "orbit"), DRIVEN),
    "rods": (("paper", "wheels", "orbit", "unloading"), DRIVEN),
    "tumbling": (("paper", "wheels", "orbit", "unloading", "detumble"), DRIVEN),
    "allocator": (("paper", "wheels", "orbit", "allocator"), SENT),
    "allocators": (("paper", "wheels", "orbit", "allocator_unloading"), SENT),
    "allocators, tumbling": (("paper", "wheels", "orbit", "allocator_unloading", "detumble"), SENT),
    "thrusters": (("paper", "thrusters"), {}),
    "goals": (("paper", "mission"), {REFERENCE: GOALS}),
}
OF_MOTORS = (wheels.MAX_TORQUE, wheels.MAX_SPEED)
SPECIAL: dict[str, list[Any]] = {
    "faults": [
        ["actuator/x effectiveness 0.5"],
        ["sensor/rate bias 0.01 0 0"],
        ["gyro bias 0.01 0 0"],
        ["wheel/1 effectiveness 0"],
        ["thruster/0 stuck_open 1"],
    ],
    "star_tracker.mounting": [HALF],
    "orbit.plates": [[0.5, 1.0, 0.0, 0.0, 0.5, 0.1, 0.0, 0.2, 0.2, 2.2]],
    "keep_out.axes": [[0.0, 0.0, -1.0]],
    "keep_out.directions": [["1 0 0"]],
    "keep_out.half_angles": [[3.0]],
    "momentum_tube.certificate": ["another"],
}


def others(parameter: Parameter, value: Any) -> Iterator[Value]:
    """Yield allowed values that differ from one."""
    tried: list[Any] = [*SPECIAL.get(parameter.name, ()), *parameter.choices]
    if isinstance(value, bool):
        tried.append(not value)
    elif not parameter.of_strings:
        for factor in (0.9, 1.1, 0.5, 3.0, 0.01, 1e-6, 1e3):
            tried.append([factor * each for each in value] if parameter.is_list else factor * value)
        added = (1e-4, 0.01, 1.0)
        tried += [[x + each for x in value] if parameter.is_list else each for each in added]
    for each in tried:
        try:
            allowed = parameter.checked(each)
        except ConfigurationError:
            continue
        if allowed != value:
            yield allowed


class Flown:
    """A case at the instant at which parameters are set, to go on from there again and again."""

    def __init__(self, case: str) -> None:
        files, given = CASES[case]
        self.parameters = load(configs(*files), given).parameters
        self.diagram = Diagram(self.parameters)
        stamps = stamps_of(float(self.parameters[PLANT]["rate"]), SHOWN)
        self._later = stamps[stamps >= SET * 1e9]
        self.diagram.run(stamps[: -self._later.size])
        self._then = self.diagram.snapshot()

    def goes_on(self) -> list[Any]:
        """Samples from the instant on, and what each part says in the end."""
        self.diagram.put_back(self._then)
        samples = self.diagram.run(self._later).tobytes()
        return [samples, *(part.advice for part in self.diagram.parts.values())]

    def with_value(self, kind: Kind, name: str, value: Value) -> list[Any] | None:
        """`goes_on` from the instant on, where a component has another value; None if refused."""
        part, own = self.diagram.parts[kind.name], self.parameters[NODE_OF[kind.name]]
        try:
            part.configure({**own, name: value})
        except ConfigurationError:
            return None
        samples = self.goes_on()
        part.configure(own)
        return samples


def settable() -> set[tuple[str, str, str]]:
    """Kind, component, and parameter that can be set in flight and that its step should heed."""
    return {
        (kind.name, component.name, each.name)
        for kind in KINDS
        for component in kind.components.values()
        for each in component.parameters
        if not each.read_only
        and not (component.observes and each in rate_observer.PARAMETERS)  # it has its own
        and not (kind is PLANTS and each in OF_MOTORS)
    }


def test_what_can_be_set_in_flight_acts_in_flight() -> None:
    """Else it is a parameter of the start, and who sets it is told so."""
    silent = settable()
    for case in CASES:
        flown = Flown(case)
        undisturbed = flown.goes_on()
        for kind, component in selected(flown.parameters):
            for parameter in component.parameters:
                key = kind.name, component.name, parameter.name
                if key not in silent:
                    continue
                value = flown.parameters[NODE_OF[kind.name]][parameter.name]
                for other in others(parameter, value):
                    told = flown.with_value(kind, parameter.name, other)
                    if told not in (None, undisturbed):
                        silent.remove(key)
                        break
        assert flown.goes_on() == undisturbed, f"{case}: all parameters are as they were"
    assert sorted(silent) == []
