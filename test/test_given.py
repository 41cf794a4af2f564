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

"""A step of somebody else's gives what nodes take of each other, or nothing."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from ppc_attitude.science.component import BODY, FIX, GYRO, QUATERNION, VECTOR, Column, Component
from ppc_attitude.science.kernel import kernel
from ppc_attitude.science.part import Part
from ppc_attitude.science.signals import ATTITUDE

TOLD = np.dtype([("told", np.float64, (8,))])
UNIT = "allowed: a quaternion of norm 1 within 0.001"


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    for i in range(outputs.given.size):
        outputs.given[i] = configuration.told[i]


@kernel
def step_attitude(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    for i in range(4):
        outputs.attitude[i] = configuration.told[i]


def given(column: Column, *told: float) -> Part:
    """Part whose step gives some numbers, after it; of one column the step is compiled once."""
    record = np.zeros((), TOLD)[()]
    record["told"][: len(told)] = told
    component = Component(
        name="given",
        configure=lambda _: np.zeros((), TOLD)[()],
        configuration=TOLD,
        outputs=(column,),
        step=step_attitude if column == ATTITUDE else step,
    )
    part = Part(component, {})
    part.hold(record)  # `configure` may make no NaN
    part.step(0)
    return part


def column(form: str, **chosen: Any) -> Column:
    return Column("given", "given", form, BODY, "1", "x", **chosen)


def row(part: Part) -> tuple[float, ...]:
    return part.output(part.component.outputs[0].name)


@pytest.mark.parametrize("of", [lambda: column(QUATERNION), lambda: ATTITUDE])
def test_a_quaternion_that_is_nearly_a_unit_one_is_normalised(of: Callable[[], Column]) -> None:
    """As every node does that takes it."""
    long = 1.0 + 1e-6
    near = row(given(of(), 0.0, 0.6 * long, 0.0, 0.8 * long))
    assert near != (0.0, 0.6 * long, 0.0, 0.8 * long)
    assert math.hypot(*near) == pytest.approx(1.0, abs=1e-15)
    ours = (0.0, 0.6 * (1.0 + 1e-14), 0.0, 0.8)
    assert row(given(of(), *ours)) == ours


NONE = (0.0, 0.0, 0.0, 0.0)
TAKEN = [
    (ATTITUDE, NONE),  # nobody knows it
    (column(FIX, late=True), (*NONE, -1.0, 0.0, 0.0, 0.5)),
    (column(FIX, late=True), (*NONE, 0.0, 0.0, 0.0, 0.0)),
    (column(GYRO), (0.0, 0.0, 0.0, -1.0)),
    (column(VECTOR, width=2, late=True), (1.0, 0.5)),
    (column(VECTOR, width=2, late=True), (0.0, 0.0)),
]
REFUSED = [
    (ATTITUDE, (0.0, 0.0, 0.0, 1.1), f"attitude = (0.0, 0.0, 0.0, 1.1); {UNIT}, or zeros if"),
    (column(QUATERNION), NONE, f"given = (0.0, 0.0, 0.0, 0.0); {UNIT}"),
    (
        column(FIX, late=True),
        (0.0, 0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.5),
        f"1.0, -1.0, 0.0, 0.0, 0.5); {UNIT} with vari",
    ),
    (column(GYRO), (0.1, 0.0, 0.0, -1.0), "(0.1, 0.0, 0.0, -1.0); allowed: finite numbers, a v"),
    (column(VECTOR, width=2, late=True), (1.0, 1e20), "magnitudes up to 1e+30, 1e+08 s old"),
    (column(VECTOR, width=2, late=True), (math.nan, 0.1), "(nan, 0.1); allowed: finite numbers"),
    (column(VECTOR), (math.inf, 0.0, 0.0), "given = (inf, 0.0, 0.0); allowed: finite numbers"),
    (column(VECTOR), (0.0, 0.0, -1e31), "-1e+31); allowed: finite numbers of magnitudes up to"),
    (column(GYRO), (math.nan, 0.0, 0.0, 0.1), "(nan, 0.0, 0.0, 0.1); allowed: finite numbers"),
]


@pytest.mark.parametrize(("of", "told"), TAKEN)
def test_what_nodes_take_stays(of: Column, told: tuple[float, ...]) -> None:
    part = given(of, *told)
    assert row(part) == told
    assert part.raised() == ""


@kernel
def step_once(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    for i in range(3):
        outputs.given[i] = 0.0 if state.done else math.nan
    state.done = True


def test_what_a_step_gives_only_at_first_is_no_reason_that_shows_later() -> None:
    done = np.dtype([("done", np.bool_)])
    part = Part(Component(name="once", state=done, outputs=(column(VECTOR),), step=step_once), {})
    part.step(0)
    assert math.isnan(row(part)[0])
    assert part.raised() == ""


@pytest.mark.parametrize(("of", "told", "text"), REFUSED)
def test_what_no_node_takes_is_none_and_is_named(
    of: Column, told: tuple[float, ...], text: str
) -> None:
    """In the loop in process too, where nobody would refuse it."""
    part = given(of, *told)
    assert all(map(math.isnan, row(part)))
    assert part.raised().startswith("gave ")
    assert text in part.raised()
