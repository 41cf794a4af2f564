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

"""Sums and multiples of three-vectors, computed in the lanes of one register of the processor.

LLVM does not find out by itself that the three numbers of a vector take the same operations. Lanes
pay where a vector stays in its register over several operations, as in products of matrices; for a
single sum packing costs as much as it saves. Every lane rounds as scalar arithmetic does, so the
results are the same to the last bit.
"""

from typing import Any

from numba import types
from numba.extending import intrinsic

from ppc_attitude.science.kernel import ir

_PLACES = [ir.Constant(ir.IntType(32), k) for k in range(3)]
_LANES = ir.VectorType(ir.DoubleType(), 4)
_VECTOR: Any = vars(types)["UniTuple"](types.float64, 3)  # Numba does not annotate it


def _packed(builder: Any, numbers: Any) -> Any:
    """Fill the lanes with the numbers of a vector, or all of them with one number."""
    lanes = ir.Constant(_LANES, ir.Undefined)
    alone = not isinstance(numbers.type, ir.ArrayType)
    for place in _PLACES:
        number = numbers if alone else builder.extract_value(numbers, place.constant)
        lanes = builder.insert_element(lanes, number, place)
    return lanes


def _by_lanes(operation: str, first: Any) -> Any:
    """Machine operation on two operands: a vector or one number, and a vector."""

    def compute(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        lanes = getattr(builder, operation)(*(_packed(builder, each) for each in arguments))
        numbers = ir.Constant(context.get_value_type(_VECTOR), ir.Undefined)
        for place in _PLACES:
            number = builder.extract_element(lanes, place)
            numbers = builder.insert_value(numbers, number, place.constant)
        return numbers

    def typed(context: Any, a: Any, b: Any) -> Any:
        return _VECTOR(first, _VECTOR), compute

    return intrinsic(typed)


added: Any = _by_lanes("fadd", _VECTOR)
"""Sum a + b of two vectors."""
multiple: Any = _by_lanes("fmul", types.float64)
"""Multiple s a of a number and a vector."""
