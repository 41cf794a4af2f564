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

"""What lives for long keeps no memory of each time that it waits."""

import sys
from array import array

import pytest
from process_helpers import node_here

from ppc_attitude.contract.topics import INJECTOR
from ppc_attitude.nodes.base import BaseNode
from ppc_attitude.nodes.visiting import listening, visiting

pytestmark = pytest.mark.ros
_FIRST, _TIMES = 500, 4000  # what is put aside for later use, is so at first


def see_no_growth(blocks: "array[int]") -> None:
    assert blocks[-1] - blocks[_FIRST] < _TIMES / 4


def test_a_node_that_wakes_often_does_not_grow(monkeypatch: pytest.MonkeyPatch) -> None:
    blocks = array("q")  # which keeps no objects

    def wake(_: BaseNode) -> float:
        blocks.append(sys.getallocatedblocks())
        stop.extend([1] * (len(blocks) > _FIRST + _TIMES))
        return 0.0

    monkeypatch.setattr(BaseNode, "wake", wake)
    with node_here(INJECTOR) as (main, stop):
        assert main() == 0
    see_no_growth(blocks)


def test_who_listens_for_long_does_not_grow() -> None:
    blocks = array("q")
    with visiting("onlooker", "") as node, listening(node) as listen:
        for _ in range(_FIRST + _TIMES):
            listen(1e-5)
            blocks.append(sys.getallocatedblocks())
    see_no_growth(blocks)
