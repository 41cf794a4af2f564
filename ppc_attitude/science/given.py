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

"""The outputs that nodes accept of each other, and that a component of another package may give.

A node refuses numbers that are not finite or too large, a quaternion that is no attitude and an
impossible variance, and normalises a quaternion that is nearly a unit one. Here the same is done
with the outputs of a component of another package. So the loop in process gives the same numbers
as the nodes, and the error names the component at fault, not a node that waits for its messages.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.attitude import normalised, quaternion_norm
from ppc_attitude.science.component import (
    FIX,
    FIX_VARIANCE,
    GYRO,
    GYRO_VARIANCE,
    OWN_TOLERANCE,
    QUATERNION,
    UNIT_TOLERANCE,
    Column,
)
from ppc_attitude.science.controllers.interface import ATTITUDE_ERROR
from ppc_attitude.science.kernel import kernel
from ppc_attitude.science.parameter import LARGEST
from ppc_attitude.science.signals import ATTITUDE
from ppc_attitude.science.stamps import LATEST

_PLAIN, _UNIT, _UNIT_OR_NONE, _FIX, _GYRO = range(5)
_UNIT_TEXT = f"a quaternion of norm 1 within {UNIT_TOLERANCE:g}"
_ALLOWED = {
    _PLAIN: f"finite numbers of magnitudes up to {LARGEST:g}",
    _UNIT: _UNIT_TEXT,
    _UNIT_OR_NONE: f"{_UNIT_TEXT}, or zeros if it is unknown",
    _FIX: f"{_UNIT_TEXT} with variances ≥ 0 and ≤ π² rad², or zeros for it where there is no fix",
    _GYRO: f"finite numbers, a variance ≥ 0 and ≤ {GYRO_VARIANCE:g} (rad/s)², or −1 with zeros",
}


def _rule(column: Column) -> int:
    if column.form == QUATERNION:
        return _UNIT_OR_NONE if column in (ATTITUDE, ATTITUDE_ERROR) else _UNIT
    return {FIX: _FIX, GYRO: _GYRO}.get(column.form, _PLAIN)


def rules_of(columns: Sequence[Column]) -> NDArray[np.int64]:
    """Each column's rule, first place among the numbers, width and `late`; shape (n, 4)."""
    starts = np.cumsum([0, *(column.width for column in columns)])
    return np.array(
        [
            (_rule(column), start, column.width, column.late)
            for column, start in zip(columns, starts, strict=False)
        ],
        np.int64,
    ).reshape(-1, 4)


@kernel
def _has_unit(row: Any) -> bool:
    """Whether a row begins with a unit quaternion; one that is nearly a unit one is normalised."""
    length = quaternion_norm(row)
    if not abs(length - 1.0) <= UNIT_TOLERANCE:
        return False
    if abs(length - 1.0) > OWN_TOLERANCE:
        row[0], row[1], row[2], row[3] = normalised((row[0], row[1], row[2], row[3]))
    return True


@kernel
def _fits(row: Any, rule: int) -> bool:
    if rule == _GYRO:
        none = row[3] == -1.0 and not np.any(row[:3])
        return none or 0.0 <= row[3] <= GYRO_VARIANCE
    if rule == _PLAIN or (rule != _UNIT and not np.any(row[:4])):
        return True
    if rule == _FIX and not (min(row[4:7]) >= 0.0 and max(row[4:7]) <= FIX_VARIANCE):
        return False
    return bool(_has_unit(row))


@kernel
def misfit(given: Any, rules: Any) -> int:
    """Index of the first column of a step's numbers that no node would take; −1 if all fit."""
    for k in range(rules.shape[0]):
        rule, start, width, late = rules[k]
        row = given[start : start + width]
        if late != 0 and not np.any(row):
            continue  # no message
        finite = np.all(np.abs(row) <= LARGEST)  # so written, it also refuses NaN
        if not finite or (late != 0 and abs(row[width - 1]) > LATEST) or not _fits(row, rule):
            return k
    return -1


@kernel
def take_all(given: Any, rules: Any) -> None:
    """Normalise the quaternions of many steps, a row each, as every node that reads them does."""
    for k in range(given.shape[0]):
        misfit(given[k], rules)


def misfit_text(columns: Sequence[Column], given: Any) -> str:
    """Text that names the first output that no node would take, and what is allowed; or empty."""
    rules = rules_of(columns)
    k = misfit(given, rules)
    if k < 0:
        return ""
    rule, start, width, _ = rules[k].tolist()
    age = f", {LATEST:g} s old at most" if columns[k].late else ""
    row = tuple(given[start : start + width].tolist())
    return f"{columns[k].name} = {row}; allowed: {_ALLOWED[rule]}{age}"
