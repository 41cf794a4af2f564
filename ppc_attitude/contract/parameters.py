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
table is tested against them. The parameters of a component are declared by the component.
"""

from collections import UserDict
from functools import cache

from ppc_attitude.contract.topics import (
    BESIDE,
    DISTURBANCE,
    HOSTED,
    INJECTOR,
    MARKERS,
    PLANT,
    RECORDER,
    SOURCES,
    TORQUE_COMMAND,
)
from ppc_attitude.science.kinds import ours_first
from ppc_attitude.science.parameter import RATE, Parameter, at_start
from ppc_attitude.science.stamps import LATEST

WAIT_FOR_RECORDER = at_start(
    "wait_for_recorder",
    False,
    "begin when `bag_recorder` listens to every topic of this node, so that nothing is missing",
)
SEND_TRUTH = at_start(
    "send_truth", False, "send the truth even where sensing is exact, because a node reads it"
)
_PLANT = (
    RATE,
    at_start(
        "lockstep",
        False,
        "step when every input of `wait_for` has arrived, instead of on the wall clock",
    ),
    at_start(
        "wait_for",
        [TORQUE_COMMAND.name, DISTURBANCE.name],
        f"inputs that lock-step waits for at every step, one or both; {TORQUE_COMMAND.name} stands "
        "for what commands the actuators",
        choices=(TORQUE_COMMAND.name, DISTURBANCE.name),
    ),
    WAIT_FOR_RECORDER,
    SEND_TRUTH,
    Parameter(
        "real_time_factor",
        0.0,
        "pace of lock-step: simulated seconds per second; 0: as fast as possible",
        low=0.0,
        high=1e6,
    ),
    at_start(
        "duration",
        0.0,
        "simulated time after which the plant ends; 0: never",
        "s",
        low=0.0,
        high=LATEST,
    ),
    Parameter(
        "command_timeout",
        0.5,
        "age beyond which a command or disturbance counts as zero; free-running: a step or more",
        "s",
        above=0.0,
        high=3600.0,
    ),
)
_INJECTOR = (
    Parameter(
        "injection_duration", 0.1, "how long an injected torque acts", "s", above=0.0, high=LATEST
    ),
    Parameter(
        "max_injected_torque",
        10.0,
        "largest injected torque, per axis; a larger one is refused",
        "N·m",
        above=0.0,
        high=1e6,
    ),
    WAIT_FOR_RECORDER,
)
_RECORDER = (
    at_start("bag", "", "folder of the bag; empty: a new, dated one under bags/"),
    at_start(
        "namespaces",
        [""],
        "namespaces whose topics go into the bag; an empty one: the recorder's own",
    ),
    at_start("storage", "mcap", "storage of the bag", choices=("mcap", "sqlite3")),
    at_start(
        "run_info",
        "",
        "JSON object with what the starter knows of the run: parameters, versions, seed",
    ),
)
_MARKERS = (
    Parameter("update_rate", 20.0, "marker messages per second", "Hz", low=0.1, high=1000.0),
    Parameter(
        "position", [0.0, 0.0, 0.0], "where the craft is drawn", "m", length=3, low=-1e6, high=1e6
    ),
    Parameter("torque_scale", 20.0, "length of the torque arrow", "m/(N·m)", above=0.0),
    Parameter(
        "disturbance_scale",
        200.0,
        "length of the disturbance arrow; no arrow is longer than 2 m",
        "m/(N·m)",
        above=0.0,
    ),
)

OWN: dict[str, tuple[Parameter, ...]] = {
    **dict.fromkeys(SOURCES, (WAIT_FOR_RECORDER,)),
    PLANT: _PLANT,
    INJECTOR: _INJECTOR,
    RECORDER: _RECORDER,
    **dict.fromkeys(BESIDE, ()),
    MARKERS: _MARKERS,
}
"""Parameters that a node has whatever components it runs."""
_OF_ROS = ("use_sim_time", "start_type_description_service")


def is_of_ros(name: str) -> bool:
    """True for a parameter that rclpy itself declares: it may stand in a file, and is not ours."""
    return name in _OF_ROS or name.startswith("qos_overrides.")


@cache
def _parameters_of(node: str) -> tuple[Parameter, ...]:
    """Every parameter of a node: its own, and those of all components that it could run.

    A component of another package that declares one of them differently is left out.
    """
    kinds = HOSTED.get(node, ())
    own = {parameter.name: parameter for parameter in OWN[node]}
    taken: dict[str, Parameter | None] = {**own, **dict.fromkeys(kind.selector for kind in kinds)}
    for kind, component in ours_first(kinds):
        tried = dict(taken)
        for parameter in component.parameters:
            name = parameter.name
            if is_of_ros(name) or tried.setdefault(name, parameter) != parameter:
                problem = f"{node} has another parameter {name} than {component.name}"
                allowed = "allowed: one that is declared alike, or another name"
                kind.leave_out(component.name, f"{problem}; {allowed}")
                break
        else:
            taken = tried
    of_kinds = {parameter.name: parameter for kind in kinds for parameter in kind.parameters()}
    return tuple({**own, **of_kinds}.values())


class _Tables(UserDict[str, tuple[Parameter, ...]]):
    """Parameters by node; a node's components are loaded when it is asked for."""

    def __getitem__(self, node: str) -> tuple[Parameter, ...]:
        return _parameters_of(node)


PARAMETERS = _Tables(OWN)
