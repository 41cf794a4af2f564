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

"""The scenario: ROS parameter files, overlaid, checked, turned into the kernels' records."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from ppc_attitude.contract.cdr import NANOSECONDS
from ppc_attitude.contract.parameters import PARAMETERS
from ppc_attitude.contract.topics import CONTROLLER, INJECTOR, PLANT, REFERENCE, SOURCES
from ppc_attitude.contract.yaml_file import read
from ppc_attitude.science.controllers.interface import Controller
from ppc_attitude.science.controllers.registry import CONTROLLERS
from ppc_attitude.science.disturbance import PULSE
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kernel import Quaternion, Vector
from ppc_attitude.science.parameter import Value, resolved
from ppc_attitude.science.reference import REFERENCE as REFERENCE_RECORD
from ppc_attitude.science.spacecraft import PLANT as PLANT_RECORD
from ppc_attitude.science.spacecraft import inertia_matrix

# ROS's own parameters may stand in a file; they are not ours to check.
_OF_ROS = ("use_sim_time", "start_type_description_service")
_QUATERNION_TOLERANCE = 1e-3

Overrides = Mapping[str, Mapping[str, Any]]


class _Loader(yaml.SafeLoader):
    """YAML as ROS reads it: 1e-4 is a number, although YAML 1.1 asks for 1.0e-4."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+$"),
    list("-+0123456789"),
)


@dataclass(frozen=True)
class Scenario:
    """Checked parameters of every node.

    Attributes
    ----------
    parameters : mapping of str to dict
        Node name to parameter values, complete.
    """

    parameters: Mapping[str, dict[str, Value]]

    @property
    def controller(self) -> Controller:
        """The selected control law."""
        return CONTROLLERS[str(self.parameters[CONTROLLER]["controller"])]

    def number(self, node: str, name: str) -> float:
        """Value of a parameter that is a number."""
        return float(str(self.parameters[node][name]))

    def with_values(self, node: str, **values: Any) -> "Scenario":
        """Return a copy with some parameters of one node replaced, and that node checked again."""
        changed = _checked(node, {**self.parameters[node], **values})
        return Scenario({**self.parameters, node: changed})

    def awaiting_recorder(self) -> "Scenario":
        """Return the scenario of a run that is recorded from its first message on."""
        result = self
        for node in SOURCES:
            result = result.with_values(node, wait_for_recorder=True)
        return result


def read_files(paths: Iterable[Path | str]) -> dict[str, dict[str, Any]]:
    """Parameters by node from ROS parameter files; of several files the later wins.

    Raises
    ------
    ConfigurationError
        A file is missing, is not YAML, or is not a ROS parameter file; names it.
    """
    merged: dict[str, dict[str, Any]] = {}
    for path in map(Path, paths):
        for node, values in _read_file(path):
            if node == "**":
                _update_every_node(merged, values, path)
            else:
                merged.setdefault(node, {}).update(values)
    return merged


def _update_every_node(
    merged: dict[str, dict[str, Any]], values: Mapping[str, Any], path: Path
) -> None:
    """Give every node what it knows of a wildcard's values; somebody must know each."""
    known = {node: {p.name for p in table} for node, table in PARAMETERS.items()}
    for name, value in values.items():
        owners = [node for node, names in known.items() if name in names]
        if not owners:
            close = get_close_matches(name, set().union(*known.values()), n=1)
            hint = f"; did you mean {close[0]}?" if close else ""
            raise ConfigurationError(
                f"configuration file {path}: no node has a parameter {name}{hint}"
            )
        for node in owners:
            merged.setdefault(node, {})[name] = value


def _read_file(path: Path) -> list[tuple[str, dict[str, Any]]]:
    """Node names, or ** for all, with their flat parameters, in the file's order."""
    content = read(path, "configuration file", _Loader)
    if not isinstance(content, dict):
        raise ConfigurationError(
            f"configuration file {path} is not a ROS parameter file: no node name at its top"
        )
    nodes = []
    for key, body in content.items():
        name = str(key).rsplit("/", 1)[-1]
        if name not in PARAMETERS and name != "**":
            raise ConfigurationError(
                f"configuration file {path} names an unknown node {key}; "
                f"nodes are {', '.join(PARAMETERS)}"
            )
        if not isinstance(body, dict) or not isinstance(body.get("ros__parameters"), dict):
            raise ConfigurationError(
                f"configuration file {path}: {key} has no mapping ros__parameters"
            )
        try:
            nodes.append((name, dict(_flattened(body["ros__parameters"]))))
        except RecursionError:
            raise ConfigurationError(f"configuration file {path}: {key} contains itself") from None
    return nodes


def _flattened(tree: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, Any]]:
    for key, value in tree.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            yield from _flattened(value, f"{name}.")
        elif name not in _OF_ROS and not name.startswith("qos_overrides."):
            yield name, value


def scenario(given: Overrides) -> Scenario:
    """Check given parameters, fill in the defaults, and see that all of it fits together.

    Raises
    ------
    ConfigurationError
        Unknown node or name, or a value that is wrong, infeasible or does not fit another.
    """
    unknown = sorted(set(given) - set(PARAMETERS))
    if unknown:
        raise ConfigurationError(f"unknown node {unknown[0]}; nodes are {', '.join(PARAMETERS)}")
    return Scenario({node: _checked(node, given.get(node, {})) for node in PARAMETERS})


def _checked(node: str, given: Mapping[str, Any]) -> dict[str, Value]:
    """Complete parameters of a node, which fit together."""
    values = resolved(PARAMETERS[node], given, node)
    if node in _CHECKS:
        _CHECKS[node](values)
    return values


def _check_controller(values: Mapping[str, Value]) -> None:
    """See that every law can run with the parameters, whichever is selected."""
    try:
        for law in CONTROLLERS.values():
            law.configure(values)
    except ConfigurationError as error:
        raise ConfigurationError(f"{CONTROLLER}: {error}") from None


def load(paths: Sequence[Path | str], overrides: Overrides | None = None) -> Scenario:
    """Read parameter files, apply overrides, check.

    Raises
    ------
    ConfigurationError
        See `read_files` and `scenario`.
    """
    given = read_files(paths)
    for node, values in (overrides or {}).items():
        given.setdefault(node, {}).update(values)
    return scenario(given)


def unit_quaternion(name: str, values: Any) -> NDArray[np.float64]:
    """Check that a quaternion x y z w is a unit one up to rounding, and normalise it.

    Raises
    ------
    ConfigurationError
        The norm differs from 1 by more than 1e-3.
    """
    array = np.asarray(values, dtype=np.float64)
    length = float(np.linalg.norm(array))
    if not abs(length - 1.0) <= _QUATERNION_TOLERANCE:
        raise ConfigurationError(
            f"{name} = {array.tolist()} has norm {length:.6g}; allowed: 1 within "
            f"{_QUATERNION_TOLERANCE:g}"
        )
    return np.asarray(array / length)


def plant_record(values: Mapping[str, Any]) -> Any:
    """Record of dtype `PLANT` from the plant's parameters.

    Raises
    ------
    ConfigurationError
        Impossible inertia, initial attitude, or torque limits that leave no torque.
    """
    record = np.zeros((), PLANT_RECORD)[()]
    inertia = inertia_matrix(f"{PLANT}: inertia", values["inertia"])
    record["inertia"] = inertia
    record["inertia_inverse"] = np.linalg.inv(inertia)
    for name in ("max_torque", "min_torque", "attitude_noise", "rate_noise", "seed"):
        record[name] = values[name]
    if values["min_torque"] >= values["max_torque"]:
        raise ConfigurationError(
            f"{PLANT}: min_torque = {values['min_torque']} N·m must be smaller than max_torque = "
            f"{values['max_torque']} N·m"
        )
    unit_quaternion(f"{PLANT}: initial_attitude", values["initial_attitude"])
    return record


def initial_state(values: Mapping[str, Any]) -> tuple[Quaternion, Vector]:
    """Attitude x y z w and angular velocity [rad/s] at t = 0."""
    attitude = unit_quaternion("initial_attitude", values["initial_attitude"])
    x, y, z, w = map(float, attitude)
    rate_x, rate_y, rate_z = map(float, values["initial_angular_velocity"])
    return (x, y, z, w), (rate_x, rate_y, rate_z)


def reference_record(values: Mapping[str, Any]) -> Any:
    """Record of dtype `REFERENCE` from the reference generator's parameters.

    Raises
    ------
    ConfigurationError
        The initial attitude is not a unit quaternion.
    """
    record = np.zeros((), REFERENCE_RECORD)[()]
    name = f"{REFERENCE}: initial_attitude"
    record["initial_attitude"] = unit_quaternion(name, values["initial_attitude"])
    record["amplitude"] = values["amplitude"]
    record["period_constant"] = values["period_constant"]
    return record


def nanoseconds(time: float) -> int:
    """Whole nanoseconds of a time [s]."""
    return round(time * NANOSECONDS)


def pulse(start_ns: int, duration: float, torque: Sequence[float]) -> Any:
    """One pulse (array of dtype `PULSE`, length 1) from `start_ns` on, for `duration` [s]."""
    return np.array([(start_ns, start_ns + nanoseconds(duration), tuple(torque))], PULSE)


def pulses(values: Mapping[str, Any]) -> NDArray[Any]:
    """Scheduled pulses, array of dtype `PULSE`, from the injector's parameters.

    Raises
    ------
    ConfigurationError
        Times, durations and torques are not equally many.
    """
    times, durations = values["pulse_times"], values["pulse_durations"]
    torques = values["pulse_torques"]
    if not len(times) == len(durations) == len(torques) // 3:
        raise ConfigurationError(
            f"{INJECTOR}: pulse_times has {len(times)} values, pulse_durations {len(durations)}, "
            f"pulse_torques {len(torques)}; allowed: n, n and 3 n"
        )
    parts = [
        pulse(nanoseconds(time), duration, torques[3 * i : 3 * i + 3])
        for i, (time, duration) in enumerate(zip(times, durations, strict=True))
    ]
    return np.concatenate(parts) if parts else np.zeros(0, PULSE)


# What a node's parameters must make together; raises where they cannot.
_CHECKS: Mapping[str, Callable[[Mapping[str, Any]], object]] = {
    PLANT: plant_record,
    REFERENCE: reference_record,
    INJECTOR: pulses,
    CONTROLLER: _check_controller,
}
