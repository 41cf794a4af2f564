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

"""The parameters of every node, each declared once: type, default, unit, range, description.

The nodes declare these, the configuration loader checks against them, and the documentation's
table is tested against them. The controller's own come with each law.
"""

from ppc_attitude.contract.topics import (
    CONTROLLER,
    DISTURBANCE,
    INJECTOR,
    MARKERS,
    PLANT,
    RECORDER,
    REFERENCE,
    TORQUE_COMMAND,
)
from ppc_attitude.science.controllers.common import INERTIA, MAX_TORQUE
from ppc_attitude.science.controllers.registry import CONTROLLERS, all_parameters
from ppc_attitude.science.parameter import Parameter

HALF_DEGREE = 0.008726646259971648  # 0.5°/s in rad/s

WAIT_FOR_RECORDER = Parameter(
    "wait_for_recorder",
    False,
    "begin when `bag_recorder` listens to every topic of this node, so that nothing is missing",
    read_only=True,
)
_PLANT = (
    Parameter(
        "rate",
        100.0,
        "steps per second of simulated time",
        "Hz",
        low=1.0,
        high=10000.0,
        read_only=True,
    ),
    Parameter(
        "inertia",
        INERTIA.default,
        "inertia J of the craft, row-major; symmetric positive definite",
        "kg·m²",
        length=9,
    ),
    Parameter(
        "initial_attitude",
        [0.1554, 0.4271, 0.4792, 0.7509],
        "attitude at t = 0, x y z w, body to inertial; normalised if within 1e-3",
        length=4,
        read_only=True,
    ),
    Parameter(
        "initial_angular_velocity",
        [0.0, 0.0, 0.0],
        "angular velocity at t = 0, body axes",
        "rad/s",
        length=3,
        low=-100.0,
        high=100.0,
        read_only=True,
    ),
    Parameter(
        "max_torque", MAX_TORQUE.default, "actuator limit per axis", "N·m", above=0.0, high=1e6
    ),
    Parameter(
        "min_torque", 1e-4, "below this the actuator gives nothing", "N·m", low=0.0, high=1e6
    ),
    Parameter(
        "lockstep",
        False,
        "step when every input of `wait_for` has arrived, instead of on the wall clock",
        read_only=True,
    ),
    Parameter(
        "wait_for",
        [TORQUE_COMMAND.name, DISTURBANCE.name],
        "inputs that lock-step waits for at every step",
        choices=(TORQUE_COMMAND.name, DISTURBANCE.name),
        read_only=True,
    ),
    WAIT_FOR_RECORDER,
    Parameter(
        "real_time_factor",
        0.0,
        "pace of lock-step: simulated seconds per second; 0: as fast as possible",
        low=0.0,
        high=1e6,
    ),
    Parameter(
        "duration",
        0.0,
        "simulated time after which the plant ends; 0: never",
        "s",
        low=0.0,
        high=1e8,
        read_only=True,
    ),
    Parameter(
        "command_timeout",
        0.5,
        "free-running: zero torque when the last command is older",
        "s",
        above=0.0,
        high=3600.0,
    ),
    Parameter(
        "attitude_noise",
        0.0,
        "standard deviation of the measured attitude, per axis",
        "rad",
        low=0.0,
        high=1.0,
    ),
    Parameter(
        "rate_noise",
        0.0,
        "standard deviation of the measured rate, per axis",
        "rad/s",
        low=0.0,
        high=1.0,
    ),
    Parameter("seed", 0, "seed of the sensor noise", low=0, high=2**53, read_only=True),
)
_REFERENCE = (
    Parameter(
        "initial_attitude",
        [0.2, -0.5, -0.5, -0.6782],
        "desired attitude at t = 0, x y z w, desired frame to inertial; normalised if within 1e-3",
        length=4,
    ),
    Parameter(
        "amplitude",
        [HALF_DEGREE] * 3,
        "a of ω_d = a [cos(t/T1), sin(t/T2), −cos(t/T3)]; zeros: a fixed attitude",
        "rad/s",
        length=3,
        low=-10.0,
        high=10.0,
    ),
    Parameter("period_constant", [30.0, 20.0, 40.0], "T1, T2, T3 of ω_d", "s", length=3, above=0.0),
    WAIT_FOR_RECORDER,
)
_INJECTOR = (
    Parameter("environment", True, "the environment torque of the paper acts"),
    Parameter("pulse_times", [], "start of each scheduled pulse", "s", low=0.0, high=1e8),
    Parameter("pulse_durations", [], "duration of each scheduled pulse", "s", above=0.0, high=1e8),
    Parameter(
        "pulse_torques",
        [],
        "torque of each scheduled pulse, three values a pulse, body axes",
        "N·m",
        length=-3,
        low=-1e6,
        high=1e6,
    ),
    Parameter(
        "injection_duration", 0.1, "how long an injected torque acts", "s", above=0.0, high=1e8
    ),
    Parameter(
        "max_injected_torque",
        10.0,
        "larger injected torques are refused, per axis",
        "N·m",
        above=0.0,
        high=1e6,
    ),
    WAIT_FOR_RECORDER,
)
_CONTROLLER = (
    Parameter("controller", "ppc", "the control law", choices=tuple(CONTROLLERS), read_only=True),
    *all_parameters(),
    WAIT_FOR_RECORDER,
)
_RECORDER = (
    Parameter("bag", "", "folder of the bag; empty: a new, dated one under bags/", read_only=True),
    Parameter(
        "namespaces",
        [""],
        "namespaces whose topics go into the bag; an empty one: the recorder's own",
        read_only=True,
    ),
    Parameter("storage", "mcap", "storage of the bag", choices=("mcap", "sqlite3"), read_only=True),
    Parameter(
        "run_info",
        "",
        "JSON object with what the starter knows of the run: parameters, versions, seed",
        read_only=True,
    ),
)
_MARKERS = (
    Parameter("update_rate", 20.0, "pictures per second", "Hz", low=0.1, high=1000.0),
    Parameter(
        "position", [0.0, 0.0, 0.0], "where the craft is drawn", "m", length=3, low=-1e6, high=1e6
    ),
    Parameter("torque_scale", 20.0, "length of the torque arrow", "m/(N·m)", above=0.0, high=1e6),
    Parameter(
        "disturbance_scale",
        200.0,
        "length of the disturbance arrow; no arrow is longer than 2 m",
        "m/(N·m)",
        above=0.0,
        high=1e6,
    ),
)

PARAMETERS: dict[str, tuple[Parameter, ...]] = {
    PLANT: _PLANT,
    REFERENCE: _REFERENCE,
    CONTROLLER: _CONTROLLER,
    INJECTOR: _INJECTOR,
    RECORDER: _RECORDER,
    MARKERS: _MARKERS,
}
