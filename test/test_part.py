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

"""A component as it is run: what it tells of its last step."""

import pytest

from ppc_attitude.contract.topics import CONTROLLER
from ppc_attitude.science.kinds import CONTROLLERS
from ppc_attitude.science.part import Part
from ppc_attitude.simulation.scenario import scenario

ENVELOPES = {"attitude_error": "attitude_envelope", "rate_error": "rate_envelope"}


@pytest.mark.parametrize("law", CONTROLLERS.components)
def test_a_law_tells_how_much_of_its_own_envelopes_is_filled(law: str) -> None:
    values = scenario({CONTROLLER: {"controller": law}}).parameters[CONTROLLER]
    part = Part(CONTROLLERS.components[law], values)
    given = part.outputs[0]
    expected = {}
    for error, envelope in ENVELOPES.items():
        if envelope in given.dtype.names:
            given[error][:3], given[envelope] = (0.5, -3.0, 1.0), 2.0
            expected[envelope] = 1.5
    assert part.normalised_errors() == expected
