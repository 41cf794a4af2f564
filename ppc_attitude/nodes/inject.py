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

"""One injection: a short-lived node that publishes on `disturbance/inject`."""

import time
from collections.abc import Callable
from typing import Any

import rclpy
import rclpy.utilities
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter

from ppc_attitude.contract.cdr import Codec, finite
from ppc_attitude.contract.topics import INJECT, INJECTOR
from ppc_attitude.nodes.namespaces import absolute_namespace
from ppc_attitude.nodes.qos import published
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.simulation.scenario import nanoseconds

_PATIENCE = 10.0  # [s] how long the injector may take to be found and to answer
_LATEST = 1e8  # [s] as for a scheduled pulse; no stamp is far beyond
_DURATION = "injection_duration"


class _NoAnswerError(Exception):
    """The stack did not answer; says what was waited for."""


def inject(torque: tuple[float, ...], at: float, duration: float | None, namespace: str) -> str:
    """Inject a torque [N·m] at a simulated time [s] (0: now) for a duration [s].

    Returns
    -------
    str
        What went wrong with the stack; empty if nothing did.

    Raises
    ------
    ConfigurationError
        The torque is not finite, the time too large, the namespace cannot be one, or the injector
        refuses the duration.
    """
    if not finite(torque):
        raise ConfigurationError(f"torque = {torque} N·m must be finite")
    if at > _LATEST:
        raise ConfigurationError(f"at = {at:g} s; allowed: up to {_LATEST:g}")
    home = absolute_namespace(namespace)
    rclpy.init()
    node = Node("inject", namespace=home)
    try:
        _inject(node, torque, at, duration)
    except _NoAnswerError as reason:
        return str(reason)
    finally:
        node.destroy_node()
        rclpy.utilities.try_shutdown()
    return ""


def _inject(node: Node, torque: tuple[float, ...], at: float, duration: float | None) -> None:
    publisher = node.create_publisher(WrenchStamped, INJECT.name, published(INJECT))
    _wait(
        node,
        lambda: publisher.get_subscription_count() > 0,
        f"nobody listens on {node.resolve_topic_name(INJECT.name)}: is a stack running in this "
        "domain?",
    )
    before = None if duration is None else _duration_of(node)
    if duration is not None:
        _set_duration(node, duration)
    publisher.publish(Codec(INJECT).encode(nanoseconds(at), torque))
    if not publisher.wait_for_all_acked(Duration(seconds=_PATIENCE)):
        raise _NoAnswerError(f"{INJECTOR} did not take the message within {_PATIENCE:g} s")
    if before is not None:
        # The injector fixes a pulse's duration when it takes the message, which it has before this.
        _set_duration(node, before)


def _duration_of(node: Node) -> float:
    request = GetParameters.Request(names=[_DURATION])
    answer = _call(node, GetParameters, "get_parameters", request)
    return float(answer.values[0].double_value)


def _set_duration(node: Node, duration: float) -> None:
    value = Parameter(_DURATION, Parameter.Type.DOUBLE, duration).to_parameter_msg()
    request = SetParameters.Request(parameters=[value])
    result = _call(node, SetParameters, "set_parameters", request).results[0]
    if not result.successful:
        raise ConfigurationError(result.reason)


def _call(node: Node, kind: Any, service: str, request: Any) -> Any:
    client = node.create_client(kind, f"{INJECTOR}/{service}")
    name = f"{INJECTOR} offers no {service}"
    _wait(node, client.service_is_ready, name)
    future = client.call_async(request)
    _wait(node, future.done, f"{INJECTOR} did not answer {service}")
    return future.result()


def _wait(node: Node, condition: Callable[[], bool], complaint: str) -> None:
    end = time.monotonic() + _PATIENCE
    while not condition():
        if time.monotonic() > end:
            raise _NoAnswerError(f"{complaint} (waited {_PATIENCE:g} s)")
        rclpy.spin_once(node, timeout_sec=0.05)
