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

import math
import re
from typing import Any

import numpy as np
import pytest
from craft_helpers import configs

from ppc_attitude.contract.topics import CONTROLLER, PLANT
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.parameter import Parameter, Value, exact_text, record_type, resolved
from ppc_attitude.science.sensors.direct import SEED
from ppc_attitude.simulation.scenario import load

GAIN = Parameter("gain", 1.0, "a gain", "N·m", above=0.0, high=10.0)
STEPS = Parameter("steps", 3, "a number", low=0, high=5)
ON = Parameter("on", True, "a switch")
LAW = Parameter("law", "a", "a choice", choices=("a", "b"))
PLACE = Parameter("place", "", "a text")
AXIS = Parameter("axis", [0.0, 0.0, 1.0], "a vector", length=3, low=-1.0, high=1.0)
TIMES = Parameter("times", [], "any number of numbers", low=0.0)
TORQUES = Parameter("torques", [], "three a time", length=-3)
LAWS = Parameter("laws", ["a"], "choices", choices=("a", "b"))
SLOW = {"rate": 7.0, "thrusters.period": 1.0 / 7.0}
WEAK = dict.fromkeys(("momentum_tube.brake", "momentum_tube.B"), [0.04] * 3) | {
    "max_torque": 0.04712835
}
TABLE = (GAIN, STEPS, ON, LAW, PLACE, AXIS, TIMES, TORQUES, LAWS)


@pytest.mark.parametrize(
    ("parameter", "value", "expected"),
    [
        (GAIN, 2, 2.0),
        (GAIN, 10.0, 10.0),
        (STEPS, 4, 4),
        (STEPS, 4.0, 4),
        (STEPS, np.int64(4), 4),
        (ON, np.True_, True),
        (AXIS, np.array([0.5, 0.0, 1.0], np.float32), [0.5, 0.0, 1.0]),
        (ON, False, False),
        (LAW, "b", "b"),
        (PLACE, "anywhere", "anywhere"),
        (AXIS, [1, 0, 0], [1.0, 0.0, 0.0]),
        (AXIS, (0.5, 0.5, -1), [0.5, 0.5, -1.0]),
        (TIMES, [], []),
        (TIMES, [3], [3.0]),
        (TORQUES, [], []),
        (TORQUES, [1, 2, 3, 4, 5, 6], [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
        (LAWS, ["b", "a"], ["b", "a"]),
        (LAWS, [], []),
    ],
)
def test_allowed_values_come_back_in_the_parameters_type(
    parameter: Parameter, value: Any, expected: Any
) -> None:
    found = parameter.checked(value)
    assert found == expected
    assert type(found) is type(expected)
    if isinstance(found, list):
        assert [type(x) for x in found] == [type(x) for x in expected]


REFUSED: list[tuple[Parameter, list[Any]]] = [
    (GAIN, [0.0, -1.0, 10.1, math.nan, math.inf, 10**400, True, "1.0", None, [1.0]]),
    (STEPS, [2.5, 6, -1, True, math.inf, 10**400]),
    (SEED, [2**53 + 1, 10**400]),  # as floats, the first is 2**53
    (ON, [1, "true"]),
    (LAW, ["c", 1]),
    (PLACE, [3, ["a"]]),
    (AXIS, [1.0, "xyz", {"x": 1.0}, [1.0, 0.0], [1.0, 0.0, 0.0, 0.0], []]),
    (AXIS, [[1.0, 0.0, each] for each in (math.nan, False, 1.5, "0")]),
    (TIMES, [[-1.0], {}]),
    (TORQUES, [[1.0, 2.0], [1.0, 2.0, 1e300], [-1e300, 0.0, 0.0]]),
    (LAWS, [["c"], "a"]),
]


@pytest.mark.parametrize(
    ("parameter", "value"), [(parameter, each) for parameter, values in REFUSED for each in values]
)
def test_refusal_names_parameter_value_and_what_is_allowed(
    parameter: Parameter, value: Any
) -> None:
    message = refusal(parameter, value)
    assert message.startswith(f"{parameter.name} = ")
    assert f"allowed: {parameter.allowed}" in message


def test_what_is_allowed_in_words() -> None:
    assert Parameter("p", [""], "d").allowed == "a list of texts"
    assert GAIN.allowed == "finite, > 0, ≤ 10"
    assert STEPS.allowed == "an integer, ≥ 0, ≤ 5"
    assert ON.allowed == "true or false"
    assert LAW.allowed == "one of a, b"
    assert LAWS.allowed == "any of a, b"
    assert AXIS.allowed == "finite, ≥ -1, ≤ 1, 3 values"
    assert TORQUES.allowed == "finite, up to ±1e+30, a multiple of 3"
    assert "N·m" in refusal(GAIN, -1.0)


def test_an_allowed_limit_is_itself_allowed() -> None:
    """Six digits of 2π are more than 2π, and whoever took them was refused with the same limit."""
    turn = Parameter("turn", 0.0, "an angle", low=-2.0 * math.pi, high=2.0 * math.pi)
    told = [float(each) for each in re.findall(r"[≥≤] (\S+?)(?:,|$)", turn.allowed)]
    assert [turn.checked(each) for each in told] == [turn.low, turn.high]
    assert exact_text(1e-9) == "1e-09"


def own(name: str, number: float) -> dict[str, Any]:
    """Value of a parameter that another one limits: one number, or one for each part."""
    if name == "faults":
        return {name: [f"actuator/x stuck 0 for {number!r}"]}
    return {name: [number] if name.startswith("wheels.") else number}


@pytest.mark.parametrize(
    ("overlay", "node", "given", "name", "bad", "limit"),
    [
        ("paper", PLANT, {"rate": 7.0}, "faults", 0.1, 1.0 / 7.0),
        ("wheels", PLANT, {"wheels.max_speed": [430.3906]}, "wheels.initial_speed", 1e3, 430.3906),
        ("wheels", PLANT, {"wheels.coulomb": [7.3153014e-4]}, "wheels.static", 0.0, 7.3153014e-4),
        ("thrusters", PLANT, SLOW, "thrusters.min_on_time", 1.0, 1.0 / 7.0),
        ("guaranteed", CONTROLLER, WEAK, "momentum_tube.B_ramp", 1.0, 0.04712835),
    ],
)
def test_a_limit_that_another_parameter_sets_is_itself_allowed_too(
    overlay: str, node: str, given: dict[str, Any], name: str, bad: float, limit: float
) -> None:
    """`for 0.142857` of a fault was refused as less than 0.142857."""
    with pytest.raises(ConfigurationError) as raised:
        load(configs("paper", overlay), {node: {**given, **own(name, bad)}})
    assert f" {limit!r}" in str(raised.value)
    load(configs("paper", overlay), {node: {**given, **own(name, limit)}})


def refusal(parameter: Parameter, value: Any) -> str:
    with pytest.raises(ConfigurationError) as raised:
        parameter.checked(value)
    return str(raised.value)


@pytest.mark.parametrize("default", ["igrf", [""], [1.0]])
def test_a_record_has_no_field_for_what_has_no_certain_size(default: Value) -> None:
    """It had an integer for a text, and no numbers for a list."""
    with pytest.raises(ValueError, match=r"holds some, .*; allowed: a number, or a list of a cer"):
        record_type(Parameter("some", default, "x"))


def test_defaults_where_nothing_is_given() -> None:
    values = resolved(TABLE, {"gain": 3}, "node")
    assert values["gain"] == 3.0
    assert values["axis"] == [0.0, 0.0, 1.0]
    assert list(values) == [parameter.name for parameter in TABLE]


def test_a_default_is_not_shared() -> None:
    first = resolved(TABLE, {}, "node")["axis"]
    assert isinstance(first, list)
    first[0] = 9.0
    assert resolved(TABLE, {}, "node")["axis"] == [0.0, 0.0, 1.0]


def test_an_unknown_name_is_refused_with_the_nearest_known_one() -> None:
    with pytest.raises(
        ConfigurationError, match=r"node has no parameter gian; did you mean gain\?"
    ):
        resolved(TABLE, {"gian": 1.0}, "node")
    with pytest.raises(ConfigurationError, match=r"node has no parameter zzzzz$"):
        resolved(TABLE, {"zzzzz": 1.0}, "node")


def test_a_refused_value_names_its_owner() -> None:
    with pytest.raises(ConfigurationError, match=r"^node: gain = -1.0 N·m; allowed: finite, > 0"):
        resolved(TABLE, {"gain": -1.0}, "node")


def test_who_sends_a_million_numbers_does_not_get_them_back() -> None:
    with pytest.raises(
        ConfigurationError, match=r"^node: axis = \[0\.0, .* … .*; allowed: "
    ) as told:
        resolved(TABLE, {"axis": [0.0] * 1_000_000}, "node")
    assert len(str(told.value)) < 5000
