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

"""What a recorder that nobody told anything asks the other nodes: their parameters."""

from collections.abc import Callable, Iterable
from typing import Any

from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

from ppc_attitude.contract.parameters import PARAMETERS
from ppc_attitude.contract.topics import RECORDER

_PERIOD = 1.0  # [s] between two looks for nodes that have not answered


class ParameterSurvey:
    """Ask every other node of some namespaces for its parameters, whenever it appears.

    Parameters
    ----------
    node : Node
        Who asks.
    namespaces : iterable of str
        Prefixes of the nodes' names.
    on_answer : callable
        Called with all answers so far, node name to parameters, after each answer.
    """

    def __init__(
        self,
        node: Node,
        namespaces: Iterable[str],
        on_answer: Callable[[dict[str, dict[str, Any]]], None],
    ) -> None:
        self._on_answer = on_answer
        self._answers: dict[str, dict[str, Any]] = {}
        self._asked: set[str] = set()
        self._clients = {
            f"{namespace}{name}": node.create_client(
                GetParameters, f"{namespace}{name}/get_parameters"
            )
            for namespace in namespaces
            for name in PARAMETERS
            if name != RECORDER
        }
        self._timer = node.create_timer(_PERIOD, self._ask)

    def _ask(self) -> None:
        for name, client in self._clients.items():
            if name not in self._asked and client.service_is_ready():
                self._asked.add(name)
                table = PARAMETERS[name.rpartition("/")[2]]
                names = [parameter.name for parameter in table]
                future = client.call_async(GetParameters.Request(names=names))
                future.add_done_callback(self._receiver(name, names))
        if self._asked == set(self._clients):
            self._timer.cancel()

    def _receiver(self, name: str, names: list[str]) -> Callable[[Future], None]:
        def receive(future: Future) -> None:
            response = future.result()
            if response is None or len(response.values) != len(names):
                self._asked.discard(name)
                return
            values = map(parameter_value_to_python, response.values)
            self._answers[name] = {
                key: _plain(value) for key, value in zip(names, values, strict=True)
            }
            self._on_answer(self._answers)

        return receive


def _plain(value: Any) -> Any:
    return list(value) if hasattr(value, "tolist") or isinstance(value, tuple) else value
