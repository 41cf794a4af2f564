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

"""What the base of all nodes logs, how often, and which late samples it sends."""

from functools import partial
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock, call

import pytest

from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.declared import BY_COLUMN
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


def test_a_fix_is_sent_unless_its_row_is_all_zeros_or_it_is_of_before_the_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It has the stamp of its validity, and no age; a single zero is a number like others."""
    sent: list[bytes] = []
    publisher = SimpleNamespace(topic_name="fix", handle=SimpleNamespace(publish_raw=sent.append))
    monkeypatch.setattr("ppc_attitude.nodes.base.publisher_of", lambda *_: publisher)
    node: Any = SimpleNamespace(_outgoing=[], _watch=Mock())
    send = BaseNode.sender(node, BY_COLUMN["star_fix"])
    fix = (0.0, 0.0, 0.6, 0.8, 1e-8, 2e-8, 3e-8)
    send(300_000_000, (*fix, 0.1))
    send(400_000_000, (0.0,) * 8)
    send(50_000_000, (*fix, 0.1))
    (told,) = map(Codec(BY_COLUMN["star_fix"]).decode, sent)
    assert (told.stamp_ns, told.values) == (200_000_000, fix)
