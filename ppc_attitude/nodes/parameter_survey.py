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

"""A recorder that was told nothing asks the nodes of its runs for their parameters."""

from array import array
from collections.abc import Callable
from functools import partial
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

from ppc_attitude.contract.parameters import is_of_ros
from ppc_attitude.nodes.run_graph import RunGraph
from ppc_attitude.science.parameter import unquoted

_PERIOD = 1.0  # [s] between two looks for nodes that have not answered


class ParameterSurvey:
    """Ask every node of some runs for its parameters, when it appears.

    Parameters
    ----------
    node : Node
        Who asks.
    graph : RunGraph
        Knows the nodes.
    on_answer : callable
        Called with all answers so far, node name to parameters, after each answer.
    """

    def __init__(
        self,
        node: Node,
        graph: RunGraph,
        on_answer: Callable[[dict[str, dict[str, Any]]], None],
    ) -> None:
        self._node = node
        self._graph = graph
        self._on_answer = on_answer
        self._answers: dict[str, dict[str, Any]] = {}
        self._asked: dict[str, Any] = {}
        node.create_timer(_PERIOD, self._ask)

    def _ask(self) -> None:
        for home, name in self._graph.nodes:
            full = f"{home}/{name}"
            if full not in self._asked:
                client = self._node.create_client(ListParameters, f"{full}/list_parameters")
                self._asked[full] = client
            client = self._asked[full]
            if client is not None and client.service_is_ready():
                self._asked[full] = None
                future = client.call_async(ListParameters.Request())
                future.add_done_callback(partial(self._on_names, full))

    def _on_names(self, full: str, future: Future) -> None:
        listed = future.result()
        names = [] if listed is None else listed.result.names
        names = [name for name in names if not is_of_ros(name)]
        client = self._node.create_client(GetParameters, f"{full}/get_parameters")
        request = GetParameters.Request(names=names)
        client.call_async(request).add_done_callback(partial(self._on_values, full, names))

    def _on_values(self, full: str, names: list[str], future: Future) -> None:
        response = future.result()
        if response is not None and len(response.values) == len(names):
            values = [unquoted(_plain(parameter_value_to_python(each))) for each in response.values]
            self._answers[full] = dict(zip(names, values, strict=True))
            self._on_answer(self._answers)
            self._node.get_logger().info(f"the parameters of {full} are on record")

    def close(self) -> None:
        """Say who has not answered."""
        seen = {f"{home}/{name}" for home, name in self._graph.nodes}
        if silent := sorted(seen - self._answers.keys()):
            text = f"the parameters of {', '.join(silent)} are not on record: no answer yet"
            self._node.get_logger().warning(text)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, array | tuple) else value
