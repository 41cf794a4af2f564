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

"""Random craft: certified and then confirmed by the adversary, or refused with the reason."""

import re
import runpy
from typing import Any

import pytest
from docs_helpers import EXAMPLES


@pytest.mark.long
@pytest.mark.parametrize("seed", [*range(100), 70018])  # the last: a tube of noise alone, nearly
def test_a_random_craft_is_certified_and_confirmed_or_refused_with_the_reason(seed: int) -> None:
    example: dict[str, Any] = runpy.run_path(str(EXAMPLES / "random_craft.py"))
    outcome = example["outcome_of"](seed, seconds=0.5)
    if outcome.verdict == "refused":
        assert "fails (" in outcome.reason or "cannot be guaranteed" in outcome.reason
        helps = ("feasible, each line alone", "no single number", "the nearest that was found")
        assert any(each in outcome.reason for each in helps)
        failing = re.search(r"(\S+) must not exceed (\S+)", outcome.reason)
        assert failing is None or float(failing[1]) >= float(failing[2])
    else:
        assert outcome.verdict == "certified"
        assert outcome.runs > 0
        assert max(outcome.largest.values()) <= 1.0, outcome.largest
