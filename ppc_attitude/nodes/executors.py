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

"""Which executor runs a node, and what it leaves to the node."""

from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.subscription import Subscription


def new_executor() -> Executor:
    """Return the events executor where rclpy has it: it costs a fifth of the standard one."""
    try:
        from rclpy.experimental.events_executor import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor()
    return EventsExecutor()


class Flow(ReentrantCallbackGroup):
    """Messages that the executor leaves to the node itself while there are many of them.

    The standard executor takes messages first, so that in full flow no service has its turn.
    """

    full = False

    def can_execute(self, entity: Any) -> bool:
        """True if the executor may take what has come; events that are no messages always."""
        return not (self.full and isinstance(entity, Subscription))
