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

"""`ppc_attitude latency` measures what a stack does, and not how an onlooker joins it."""

from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest
from conftest import Ask

from ppc_attitude.command_line.commands import latency
from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.topics import ATTITUDE, TORQUE_COMMAND, Topic
from ppc_attitude.nodes import onlooker
from ppc_attitude.nodes.onlooker import Latencies, measure
from ppc_attitude.processes import exits
from ppc_attitude.processes.exits import RunError

Handle = Callable[[bytes], None]
STEPS, STEP, TRIP = 200, 0.01, 0.001  # how many, how long [s], and until the command [s]
JOINED = 0.055  # [s] when the probe gets all earlier states at once, after their commands


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Time [s] of a clock that a stack keeps which the probe joins late."""
    clock = [0.0]
    handles: dict[Topic, Handle] = {}
    arrivals = []
    for k in range(STEPS):
        arrivals.append((max(k * STEP, JOINED), ATTITUDE, k))
        arrivals.append((k * STEP + TRIP, TORQUE_COMMAND, k))
    arrivals.sort(key=lambda each: each[0], reverse=True)

    def subscribe(_: Any, topic: Topic, handle: Handle, *__: Any, raw: bool) -> None:
        assert raw
        handles[topic] = handle

    def listen(_: float) -> None:
        at, topic, k = arrivals.pop()
        clock[0] = at
        numbers = (0.0, 0.0, 0.0, 1.0)[-topic.width :]
        handles[topic](Codec(topic).encode(round(k * STEP * 1e9), numbers))

    monkeypatch.setattr(onlooker, "visiting", lambda *_: nullcontext())
    monkeypatch.setattr(onlooker, "listening", lambda _: nullcontext(listen))
    monkeypatch.setattr(onlooker, "subscribe", subscribe)
    return clock


def test_what_comes_while_a_probe_joins_is_not_measured(graph: list[float]) -> None:
    result = measure(lambda first: graph[0] < 1.9, joining=1.0, now=lambda: graph[0])
    np.testing.assert_allclose(result.answered, TRIP, atol=1e-9)
    assert result.states == len(result.answered) == round((1.9 - JOINED - 1.0) / STEP)
    assert result.missed == 0
    assert result.period == pytest.approx(STEP)


def test_a_stack_of_ones_own_is_measured_from_its_first_state_on(graph: list[float]) -> None:
    result = measure(lambda first: graph[0] < 1.9, now=lambda: graph[0])
    assert result.answered[0] == pytest.approx(TRIP - JOINED)


@pytest.mark.parametrize("states", [0, 1])
def test_too_few_states_to_tell_a_period_are_told(
    states: int, monkeypatch: pytest.MonkeyPatch, ask: Ask, capsys: pytest.CaptureFixture[str]
) -> None:
    few = Latencies(states, np.nan, np.full(states, TRIP))
    monkeypatch.setattr(onlooker, "measure", lambda *_: few)
    text = f"{states} states were measured; their period follows from two or more"
    told = ask("latency", "--live", "--duration", 0.01, code=exits.BROKEN)
    assert told == ("", f"error: {text}\n")
    latency._print(few)  # of a run of its own
    assert capsys.readouterr().out == f"{text}\n"


def test_a_graph_without_states_is_told_with_namespace_and_domain(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(latency, "_FIRST_STATE", 0.0)
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    goes_on = latency._live(1.0, "chaser")
    with pytest.raises(RunError, match="no state in chaser within 0 s in ROS domain 7;"):
        goes_on(None)
