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

from collections.abc import Mapping
from typing import Any

from ppc_attitude.contract.declared import samples_of
from ppc_attitude.contract.topics import Topic


def promised(parameters: Mapping[str, Mapping[str, Any]]) -> list[Topic]:
    """Return the topics that every instant of a run has, by what is known of its nodes.

    A node of the user's in the place of one of ours promises nothing.

    Parameters
    ----------
    parameters : mapping of str to mapping
        The nodes of ours that took part, with their parameters; empty if nobody knows.
    """
    sent = [topic for node in sorted(parameters) for topic in samples_of(node, parameters[node])]
    return list(dict.fromkeys(sent))
