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

"""`ppc_attitude watch` shows what a stack says, and says so when there is none."""

import io
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace
from unittest import mock

import pytest
from conftest import Ask
from process_helpers import until
from rich.console import Console

from ppc_attitude.command_line.main import main
from ppc_attitude.command_line.watch_view import view
from ppc_attitude.contract.cdr import Codec, Sample
from ppc_attitude.contract.declared import ATTITUDE_ENVELOPE, ATTITUDE_ERROR, BOUNDS, BY_COLUMN
from ppc_attitude.contract.topics import (
    APPLIED_TORQUE,
    ATTITUDE,
    DIAGNOSTICS_TOPIC,
    DISTURBANCE,
    TORQUE_COMMAND,
    Topic,
)
from ppc_attitude.nodes import onlooker
from ppc_attitude.nodes.messages import diagnostics, publisher_of
from ppc_attitude.nodes.onlooker import Onlooker, Snapshot
from ppc_attitude.nodes.visiting import listening, no_state, visiting
from ppc_attitude.processes.exits import BROKEN
from ppc_attitude.runtime.health import OK, STALE, WARN, Status
from ppc_attitude.science.stamps import NANOSECONDS


def lines(snapshot: Snapshot, silent: float = 0.0, brief: bool = False) -> list[str]:
    stream = io.StringIO()
    Console(file=stream, width=80).print(view(snapshot, silent, brief))
    return stream.getvalue().splitlines()


def line_with(text: str, shown: list[str]) -> str:
    return next(line for line in shown if text in line)


SNAPSHOT = Snapshot(
    samples={
        ATTITUDE.name: Sample(12_340_000_000, "inertial", (0.0, 0.0, 0.0, 1.0)),
        ATTITUDE_ERROR.name: Sample(12_340_000_000, "desired", (0.006, -0.001, 0.0, 1.0)),
        ATTITUDE_ENVELOPE.name: Sample(12_340_000_000, "body", (0.005, 0.004, 0.005)),
        APPLIED_TORQUE.name: Sample(12_340_000_000, "body", (0.05, 0.0, 0.0)),
        DISTURBANCE.name: Sample(12_340_000_000, "body", (0.8, 0.8, 0.8)),
    },
    health={"/ppc_controller": Status(WARN, "outside: attitude", {"steps": "3", "time [s]": "1"})},
)


def test_errors_stand_beside_their_envelopes() -> None:
    shown = lines(SNAPSHOT)
    outside = line_with("attitude x", shown)
    assert "+6.000e-03" in outside
    assert "+5.000e-03" in outside
    assert "120 % outside" in outside
    inside = line_with("attitude y", shown)
    assert "25 %" in inside
    assert "outside" not in inside
    assert "%" not in line_with("rate [°/s] x", shown)  # no such topics in this run


def test_every_error_that_a_law_bounds_is_shown() -> None:
    pairs = {error: (BY_COLUMN[error], BY_COLUMN[bound]) for error, bound in BOUNDS}
    turn, tube = pairs["turn"], pairs["momentum_error"]
    given = {turn[0]: (0.1,), turn[1]: (0.4,), tube[0]: (1e-3, 0.0, -4e-3), tube[1]: (2e-3,) * 3}
    samples = {topic.name: Sample(0, topic.frame_id, rows) for topic, rows in given.items()}
    shown = lines(Snapshot(samples={**SNAPSHOT.samples, **samples}))
    assert "25 %" in line_with("turn [°] ", shown)
    assert "+2.292e+01" in line_with("turn [°] ", shown)
    assert "50 %" in line_with("momentum [N·m·s] x", shown)
    assert "200 % outside" in line_with("momentum [N·m·s] z", shown)


def test_before_the_first_estimate_there_is_no_share_of_an_envelope() -> None:
    """The law has not been stepped: its errors and envelopes are zero."""
    pair = BY_COLUMN["rate_error"], BY_COLUMN["rate_envelope"]
    samples = {topic.name: Sample(0, topic.frame_id, (0.0,) * 3) for topic in pair}
    row = line_with("rate [°/s] x", lines(Snapshot(samples={**SNAPSHOT.samples, **samples})))
    assert "+0.000e+00" in row
    assert "%" not in row


def test_the_picture_is_drawn_anew_until_the_user_ends_it(
    monkeypatch: pytest.MonkeyPatch, ask: Ask
) -> None:
    """In a terminal that is too low for all of it, the brief one."""
    many = {f"/node_{k}": Status(OK, "running", {"steps": "3"}) for k in range(40)}
    low = replace(SNAPSHOT, health=many)
    look = mock.Mock(side_effect=[Snapshot(), SNAPSHOT, low, KeyboardInterrupt])
    for name in ("visiting", "listening"):
        monkeypatch.setattr(f"ppc_attitude.nodes.visiting.{name}", lambda *_: nullcontext())
    monkeypatch.setattr(onlooker, "Onlooker", lambda *_: SimpleNamespace(look=look))
    shown = ask("watch").out
    assert "t = 12.34 s" in shown
    assert "steps" not in shown
    assert look.call_count == 4


def test_units_and_times() -> None:
    shown = lines(SNAPSHOT)
    assert "t = 12.34 s" in shown[0]
    assert "attitude error 0.697°" in shown[0]  # of the truth nobody knows here
    assert "no new state" not in shown[0]
    assert "no new state for 7 s" in lines(SNAPSHOT, silent=7.0)[0]
    assert "torque [mN·m]" in line_with("torque", shown)
    row = next(line for line in shown if line.startswith("│ x "))
    assert "+5.000e+01" in row
    assert "+8.000e+02" in row


def test_health_is_told_with_its_level() -> None:
    row = line_with("/ppc_controller", lines(SNAPSHOT))
    assert "WARN outside: attitude" in row
    assert "steps 3" in row
    assert "time" not in row


def test_who_is_not_well_comes_first_and_a_small_terminal_gets_less_of_the_others() -> None:
    calm = {"/an_estimator": Status(OK, "running", {"steps": "3"})}
    snapshot = Snapshot(health={**calm, **SNAPSHOT.health})
    for brief in (False, True):
        shown = lines(snapshot, brief=brief)
        ill, well = line_with("/ppc_controller", shown), line_with("/an_estimator", shown)
        assert shown.index(ill) < shown.index(well)
        assert "steps 3" in ill
        assert ("steps 3" in well) != brief


def test_what_does_not_come_any_more_while_states_do_is_none_of_the_present() -> None:
    """A killed law was healthy, and its last torque the present one, as long as one looked."""
    now, names = 0.0, ("/law", "/slow")
    with visiting("onlooker", "") as node, listening(node) as listen:
        onlooker = Onlooker(node, listen)
        onlooker.now = lambda: now  # type: ignore[method-assign]
        senders = {topic: publisher_of(node, topic) for topic in (ATTITUDE, TORQUE_COMMAND)}
        health = publisher_of(node, DIAGNOSTICS_TOPIC)

        def send(second: int, *topics: Topic) -> None:
            for topic in topics:
                values = (0.0, 0.0, 0.0, 1.0)[: topic.width]
                senders[topic].publish(Codec(topic).encode(second * NANOSECONDS, values))

        def seen(condition: Callable[[Snapshot], object]) -> Snapshot:
            found: Snapshot = until(
                lambda: snapshot if condition(snapshot := onlooker.look(0.01)) else None, "all"
            )
            return found

        send(100, *senders)
        for name in names:
            well = Status(OK, "running", {})
            health.publish(diagnostics(100 * NANOSECONDS, name, "status", well))
        seen(lambda snapshot: len(snapshot.health) + len(snapshot.samples) == 4)
        for now, second in ((3.0, 103), (4.0, 104), (9.0, 20)):  # and at last after a reset
            text, silent = f"waits at {second} s", now > 3.0
            send(second, ATTITUDE)
            # Who waits reports by the wall clock, and its time stands still.
            health.publish(diagnostics(0, names[1], "status", Status(STALE, text, {})))
            snapshot = seen(
                lambda snapshot, text=text, at=second * NANOSECONDS: (
                    snapshot.health[names[1]].summary == text
                    and snapshot.samples[ATTITUDE.name].stamp_ns == at
                )
            )
            assert (TORQUE_COMMAND.name in snapshot.samples) != silent
            gone = Status(STALE, f"silent for {now:.0f} s", {})
            assert snapshot.health[names[0]] == (gone if silent else well)


def test_nothing_yet() -> None:
    assert "waiting for attitude" in lines(Snapshot())[0]


def test_it_fits_a_narrow_terminal() -> None:
    assert max(map(len, lines(SNAPSHOT, silent=100.0))) <= 80


def test_an_empty_domain_is_told_as_ros_reads_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "")
    assert "no state within 0 s in ROS domain 0;" in str(no_state("", 0.0))


def test_no_stack_is_an_error(capfd: pytest.CaptureFixture[str], ros_domain: int) -> None:
    assert main(["watch", "--once", "--timeout", "0.2"]) == BROKEN
    error = capfd.readouterr().err
    assert error.startswith("error: no state within 0.2 s")
    assert f"domain {ros_domain}" in error
    assert error.count("\n") == 1
