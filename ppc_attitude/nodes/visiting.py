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

"""Visits of commands to a running stack: a node for a while, patience, and an injection."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from uuid import uuid4

import rclpy
import rclpy.utilities
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rclpy.validate_namespace import validate_namespace

from ppc_attitude.contract.topics import INJECTOR
from ppc_attitude.nodes.discovery import DOMAIN, check_discovery
from ppc_attitude.nodes.messages import new_executor
from ppc_attitude.nodes.running import check_name, refusals_of_ros
from ppc_attitude.processes.exits import BROKEN, RunError
from ppc_attitude.processes.leaving import leaving
from ppc_attitude.science.errors import ConfigurationError

_PATIENCE = 30.0  # [s] for a node to be found and to answer; a machine may be busy
_LOOK = 0.05  # [s] between two looks for an answer
_AGAIN = 2.0  # [s] after which a question whose answer does not come is asked again


@contextmanager
def visiting(name: str, namespace: str) -> Iterator[Node]:
    """Give a node of this name in the namespace of a stack, for as long as it is needed.

    Raises
    ------
    ConfigurationError
        The namespace is invalid, or in this environment no node can start or find another.
    """
    home = f"/{namespace.strip('/')}"  # given with or without its slashes
    check_name(validate_namespace, home, f"namespace {namespace!r}")
    check_discovery(os.environ)
    node = None
    try:
        with refusals_of_ros():
            rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
            node = Node(name, namespace=home)
        yield node
    finally:
        with leaving(BROKEN):
            if node is not None:
                node.destroy_node()
            rclpy.utilities.try_shutdown()


@contextmanager
def listening(node: Node) -> Iterator[Callable[[float], None]]:
    """Give a function that takes in the messages of a node for some time [s]."""
    executor = new_executor()
    executor.add_node(node)

    def listen(patience: float) -> None:
        end = time.monotonic() + patience
        while (left := end - time.monotonic()) > 0.0:
            executor.spin_once(timeout_sec=left)

    try:
        yield listen
    finally:
        executor.shutdown()  # or it keeps the node in the graph


def no_state(namespace: str, patience: float) -> RunError:
    """Return the error if no state came within a time [s]; it names namespace and domain."""
    return RunError(
        f"no state{f' in {namespace}' if namespace else ''} within {patience:g} s "
        f"in ROS domain {_domain()}; `ppc_attitude run` prints the domain that it uses"
    )


def _domain() -> str:
    return os.environ.get(DOMAIN) or "0"  # an empty one is none, as ROS reads it


def await_answer(
    node: Node,
    condition: Callable[[], bool],
    complaint: str,
    ask: Callable[[], object] = lambda: None,
) -> None:
    """Let a node work until a condition holds; call `ask` at the start, and again now and then.

    A message is lost if its reader does not know the sender yet, even with reliable QoS.

    Raises
    ------
    TimeoutError
        The condition did not hold in time; the message is the complaint.
    """
    begin = asked = time.monotonic()
    ask()
    with listening(node) as listen:
        while not condition():
            now = time.monotonic()
            if now > begin + _PATIENCE:
                waited = f"waited {_PATIENCE:g} s in ROS domain {_domain()}"
                raise TimeoutError(f"{complaint} ({waited})")
            if now > asked + _AGAIN:
                asked = now
                ask()
            listen(_LOOK)


def inject(torque: tuple[float, ...], at: float, duration: float | None, namespace: str) -> str:
    """Inject a torque [N·m] in body axes; return from when to when it acts, as the injector says.

    It begins at the simulated time `at` [s], or now if that is 0 or past. Without a duration [s] it
    acts for the injector's `injection_duration`.

    Raises
    ------
    ConfigurationError
        The namespace is invalid, or the injector refuses.
    TimeoutError
        No injector answered.
    """
    # By its name the injector knows a request that is sent again, and adds the torque once.
    wishes = {"torque": list(torque), "start": at, "duration": duration, "request": uuid4().hex}
    parameters = [
        Parameter(key, value=value).to_parameter_msg()
        for key, value in wishes.items()
        if value is not None
    ]
    request = SetParametersAtomically.Request(parameters=parameters)
    calls: list[Any] = []
    with visiting("inject", namespace) as node:
        client = node.create_client(SetParametersAtomically, f"{INJECTOR}/inject")
        name = node.resolve_service_name(f"{INJECTOR}/inject")
        complaint = f"no node offers the service {name}: a stack must run there"
        await_answer(node, client.service_is_ready, complaint)
        unknown = "whether the torque acts is not known; disturbance/torque shows it"
        await_answer(
            node,
            lambda: any(each.done() for each in calls),
            f"{name} did not answer: {unknown}",
            lambda: calls.append(client.call_async(request)),
        )
        result = next(each for each in calls if each.done()).result().result
    if not result.successful:
        raise ConfigurationError(result.reason)
    return str(result.reason)
