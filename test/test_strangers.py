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

"""Who is not of the run: a second publisher is named, nobody waits for who takes nothing."""

import re
import signal
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from conftest import StartProcess
from peer import node_apart, peer
from process_helpers import PAPER, Node, Run, pace, ran
from rclpy.duration import Duration
from rclpy.qos import HistoryPolicy, QoSProfile

from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line.parameter_file import parameter_file
from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.topics import (
    ATTITUDE,
    CONTROLLER,
    ESTIMATOR,
    INJECTOR,
    PLANT,
    RECORDER,
    REFERENCE,
)
from ppc_attitude.nodes.base import BaseNode
from ppc_attitude.nodes.messages import message_class, publisher_of
from ppc_attitude.nodes.publisher_watch import PublisherWatch
from ppc_attitude.processes.telling import LINGERS
from ppc_attitude.science.stamps import NANOSECONDS
from ppc_attitude.simulation.scenario import load

ros = pytest.mark.ros
long = pytest.mark.long


@ros
@pytest.mark.parametrize(
    "name",
    [
        CONTROLLER,
        *(pytest.param(name, marks=long) for name in (PLANT, ESTIMATOR, REFERENCE, INJECTOR)),
    ],
)
def test_a_second_publisher_is_named_ends_and_makes_the_bag_incomplete(
    name: str, tmp_path: Path, start_process: StartProcess
) -> None:
    sensors = [PAPER.with_name("sensors_smallsat.yaml")] if name == ESTIMATOR else []
    options = ["--duration", "10000", *(f"--config={file}" for file in sensors)]
    run = Run(start_process, tmp_path / "bag", *options, overlay=pace(0.05))
    # After 11 s of the clock: who is that old never gives way, nor is its time one's who begins.
    run.reaches(0.55)
    parameters = tmp_path / "parameters.yaml"
    parameters.write_text(parameter_file(load([PAPER, tmp_path / "overlay.yaml", *sensors])))
    second = Node(start_process, tmp_path, name, file=parameters)
    assert second.ends() == 3, second.err
    found = re.search(rf"another node publishes (\S+): /{name}, /{name};", second.err)
    assert found, second.err
    assert "Traceback" not in second.err
    run.reaches(run.time + 0.1)  # it goes on
    run.send(signal.SIGINT)
    assert run.ends() == 3
    # The first cause is told: that of the node, or of the recorder if it heard both for longer.
    assert re.search(rf"(another node publishes|came from several).*: /{name}, /{name}", run.err)
    told = f"{found[1]} came from several nodes: /{name}, /{name}"
    warnings = read_run(run.bag).warnings
    assert any(told in warning for warning in warnings), (found[1], warnings, run.err)


@ros
def test_a_publisher_whose_stamp_stands_still_is_named_with_what_is_refused(
    tmp_path: Path, start_process: StartProcess
) -> None:
    injector = Node(start_process, tmp_path, INJECTOR)
    injector.says("ready")
    stale, new = (
        Codec(ATTITUDE).encode(seconds * NANOSECONDS, (0.0, 0.0, 0.0, 1.0)) for seconds in (5, 6)
    )
    found = "stamp 5.000000 s is out of order; this topic's publishers are /peer, /stuck"
    with peer(ATTITUDE) as stack, node_apart("stuck") as stuck:
        publisher = publisher_of(stuck, ATTITUDE)

        def sent_until_told() -> bool:
            stack.send(ATTITUDE, new)
            publisher.publish(stale)
            return found in injector.err

        stack.until(sent_until_told, found)


@long
@ros
def test_a_subscriber_that_keeps_all_and_reads_nothing_is_named_and_not_waited_for(
    tmp_path: Path, start_process: StartProcess
) -> None:
    with peer() as stranger:
        keep_all = QoSProfile(history=HistoryPolicy.KEEP_ALL)
        kind = message_class(ATTITUDE.msgtype)
        stranger.node.create_subscription(kind, ATTITUDE.name, lambda message: None, keep_all)
        # More than Fast DDS lets a reader keep, which then acknowledges no more.
        run = Run(start_process, tmp_path / "bag", "--duration", "120")
        run.ends()
    assert run.process.returncode == 0, run.err
    assert f"/peer did not take all of /{ATTITUDE.name}: this node ends" in run.err
    assert read_run(run.bag).missing_messages == 0


@pytest.mark.parametrize("home", ["/", "/chief"])
@pytest.mark.parametrize(
    ("stranger", "recorder_goes", "waited", "lingers", "named"),
    [
        (True, 3.0, 3.0, True, "/slow"),
        (True, 99.0, 8.0, True, "/slow"),
        (False, 99.0, 8.0, False, f"/{RECORDER}"),
    ],
)
def test_who_is_not_of_the_run_is_waited_for_until_its_recorder_goes(
    stranger: bool,
    recorder_goes: float,
    waited: float,
    lingers: bool,
    named: str,
    home: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The recorder of several craft is in no namespace, or in that of one of them."""
    time, told, warnings = [0.0], [], []

    def wait(duration: Duration) -> bool:
        time[0] += duration.nanoseconds * 1e-9
        return False

    def readers(topic: str) -> list[SimpleNamespace]:
        names = [RECORDER] * (time[0] < recorder_goes) + ["slow"] * stranger
        return [SimpleNamespace(node_namespace="/", node_name=name) for name in names]

    publisher = SimpleNamespace(
        topic_name="/attitude", get_subscription_count=lambda: 1, wait_for_all_acked=wait
    )
    node: Any = SimpleNamespace(
        now=lambda: time[0],
        get_namespace=lambda: home,
        get_subscriptions_info_by_topic=readers,
        get_logger=lambda: SimpleNamespace(warning=warnings.append),
    )
    monkeypatch.setattr("ppc_attitude.nodes.base.tell", lambda fact, value: told.append(fact))
    BaseNode._await_readers(node, [publisher])
    assert time[0] == pytest.approx(waited, abs=0.11)
    assert (LINGERS in told) == lingers
    assert warnings == [f"{named} did not take all of /attitude: this node ends"]


def test_who_shares_a_clock_or_a_record_is_named_once_and_nobody_who_was_killed() -> None:
    warnings: list[str] = []
    names = [PLANT, PLANT]

    def publishers(topic: str) -> list[SimpleNamespace]:
        return [
            SimpleNamespace(endpoint_gid=[k], node_namespace=f"/{k}", node_name=name)
            for k, name in enumerate(names)
        ]

    node: Any = SimpleNamespace(
        count_publishers=lambda topic: len(names),
        get_publishers_info_by_topic=publishers,
        get_logger=lambda: SimpleNamespace(warning=warnings.append),
    )
    watch = PublisherWatch(node, 0.0)
    watch.add_shared("/clock")

    def look(*seconds: int) -> None:
        for each in seconds:
            watch.look(each)

    look(2, 20)
    names[:] = [PLANT]
    look(25)
    names[:] = [PLANT, PLANT]
    look(30, 50)
    assert not warnings
    look(61, 70, 120)
    told = "several nodes publish /clock, and every reader hears all of them"
    assert warnings == [f"{told}: /0/{PLANT}, /1/{PLANT}"]
    assert not watch.found


@ros
def test_a_working_recorder_has_loaded_no_law_no_reader_and_no_compiler(tmp_path: Path) -> None:
    script = (
        "import sys, rclpy\n"
        "from ppc_attitude.nodes.bag_recorder import BagRecorder\n"
        "rclpy.init()\n"
        "BagRecorder()\n"
        "unneeded = ('numba', 'ppc_attitude.bags.folder', 'ppc_attitude.bags.source')\n"
        "print(sorted(m for m in sys.modules if m in unneeded or '.controllers' in m))"
    )
    assert ran([sys.executable, "-c", script], cwd=tmp_path).stdout == "[]\n"
