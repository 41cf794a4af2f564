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

"""What the base of all nodes logs, and how often."""

from functools import partial
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock, call

from ppc_attitude.nodes.base import BaseNode
from ppc_attitude.runtime.health import Health
from ppc_attitude.science.hooks import Advice


def test_advice_has_its_severity_and_an_event_is_mentioned_at_most_once_a_second() -> None:
    log, times = Mock(), iter((0.0, 0.9, 1.0))
    node: Any = SimpleNamespace(
        health=Health(0.0), now=partial(next, times), get_logger=lambda: log
    )
    advice = Advice("a", warning=False), Advice("b", warning=True), Advice("c", True, failed=True)
    BaseNode.say_all(node, advice)
    for text in ("d", "e", "f"):
        BaseNode.mention(node, "goal", text)
    told = [call.info("a"), call.warning("b"), call.error("c"), call.info("d"), call.info("f")]
    assert log.mock_calls == told
