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

"""Which topics every instant of a run has, by what is known of its nodes."""

from collections.abc import Collection, Mapping
from typing import Any

from ppc_attitude.contract.declared import BY_COLUMN, gives, samples_of
from ppc_attitude.contract.topics import PLANT, TORQUE_COMMAND, Topic


def promised(parameters: Mapping[str, Mapping[str, Any]], seen: Collection[Topic]) -> list[Topic]:
    """Return the topics that every instant of a run has, by what is known of its nodes.

    A node of the user's in the place of one of ours promises nothing but what others wait for.

    Parameters
    ----------
    parameters : mapping of str to mapping
        The nodes of ours that took part, with their parameters; empty if nobody knows. Then those
        did whose topics were seen; a torque command alone is no sign of our controller.
    seen : collection of Topic
        Topics that came.
    """
    present = set(parameters) or {topic.source for topic in seen if topic is not TORQUE_COMMAND}
    present.add(PLANT)
    topics: list[Topic] = []
    for node in sorted(present):
        if node in parameters:
            topics += samples_of(node, parameters[node])
        else:
            topics += [BY_COLUMN[column.name] for column in gives(node)]
    return list(dict.fromkeys(topics))
