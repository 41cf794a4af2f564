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

"""One injection: a short-lived node that asks the injector, and hears what it answers."""

from typing import Any
from uuid import uuid4

from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter

from ppc_attitude.contract.topics import INJECTOR
from ppc_attitude.nodes.visiting import await_answer, visiting
from ppc_attitude.science.errors import ConfigurationError


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
