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

"""The commands of the documentation that need a running stack run against one."""

import shlex
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import StartProcess
from craft_helpers import ROOT
from docs_helpers import ALL, Command
from geometry_msgs.msg import WrenchStamped
from peer import Peer, peer
from process_helpers import PATIENCE
from std_srvs.srv import SetBool

from ppc_attitude.command_line.main import main
from ppc_attitude.contract.topics import CONTROLLER, INJECTOR
from ppc_attitude.processes import exits

pytestmark = [pytest.mark.ros, pytest.mark.long]


def lines(*words: str) -> list[Command]:
    """Commands that begin with these words."""
    return [command for command in ALL if command.words[: len(words)] == list(words)]


@pytest.fixture
def stack(start_process: StartProcess, tmp_path: Path) -> dict[str, subprocess.Popen[str]]:
    """Every node that the pages start with `ros2 run`, and an injector without a namespace.

    Plants in one namespace would be rivals: what is the same but for its mode gets another.
    """
    (tmp_path / "config").symlink_to(ROOT / "config")
    node_lines = [command.words[3:] for command in lines("ros2", "run", "ppc_attitude")]
    node_lines = [words for words in node_lines if not any("wait_for:=" in word for word in words)]
    assert len(node_lines) >= 5
    node_lines += [[INJECTOR], [CONTROLLER]]
    running: dict[str, subprocess.Popen[str]] = {}
    for words in node_lines:
        chaser = "/chaser" if "__ns:=/chaser" in words else ""
        full_name = f"{chaser}/{words[0]}"
        if full_name in running:
            full_name = f"/other{full_name}"
            words = [*words, "-r", "__ns:=/other"]
        assert full_name not in running
        command = [sys.executable, "-m", f"ppc_attitude.nodes.{words[0]}", *words[1:]]
        running[full_name] = start_process(command, cwd=tmp_path)
    return running


def test_commands_for_a_running_stack(
    stack: dict[str, subprocess.Popen[str]], capfd: pytest.CaptureFixture[str]
) -> None:
    with peer() as asker:
        up = {name.lstrip("/") for name in stack}
        asker.until(lambda: up <= set(asker.health), "every node's health")
        set_parameters(asker)
        call_services(asker)
        publish(asker)
    injections = lines("ppc_attitude", "inject")
    assert len(injections) >= 4
    for command in injections:
        assert main(command.words[1:]) == exits.DONE, capfd.readouterr().err
    (watch,) = lines("ppc_attitude", "watch")
    for home in ([], ["--namespace", "chaser"]):
        once = [*watch.words[1:], *home, "--once", "--timeout", str(PATIENCE)]
        assert main(once) == exits.DONE
        assert "torque" in capfd.readouterr().out
    for name, process in stack.items():
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, (name, said)


def set_parameters(asker: Peer) -> None:
    """`ros2 param set NODE NAME VALUE`."""
    given = [command.words[3:] for command in lines("ros2", "param", "set")]
    for node, name, value in given:
        result = asker.set_parameter(node.lstrip("/"), name, yaml.safe_load(value))
        assert result.successful, result.reason


def call_services(asker: Peer) -> None:
    """`ros2 service call NAME TYPE VALUES`, which the pages have in their text."""
    text = (ROOT / "docs" / "how-to.md").read_text(encoding="utf-8")
    start = text.index("ros2 service call")
    name, kind, values = shlex.split(text[start : text.index("`", start)])[3:]
    assert kind == "std_srvs/srv/SetBool"
    answer = asker.call(SetBool, name, SetBool.Request(**yaml.safe_load(values)))
    assert answer.success
    assert answer.message == "disabled: zero torque"


def publish(asker: Peer) -> None:
    """`ros2 topic pub --once -w LISTENERS TOPIC TYPE VALUES`."""
    ((wait, _, topic, kind, values),) = (
        command.words[4:] for command in lines("ros2", "topic", "pub", "--once")
    )
    assert wait == "-w"
    assert kind == "geometry_msgs/msg/WrenchStamped"
    message = WrenchStamped()
    fill(message, yaml.safe_load(values))
    before = accepted(asker)
    publisher = asker.node.create_publisher(WrenchStamped, topic, 10)
    # This stack has no recorder, which is the other listener of the page.
    asker.until(lambda: publisher.get_subscription_count() > 0, f"a subscriber of {topic}")
    publisher.publish(message)
    asker.until(lambda: accepted(asker) > before, "the injection")


def fill(message: Any, values: dict[str, Any]) -> None:
    """Set the fields that are given."""
    for name, value in values.items():
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        else:
            setattr(message, name, value)


def accepted(asker: Peer) -> int:
    """Injections that the injector has accepted."""
    health = asker.until(lambda: asker.health.get(INJECTOR), f"{INJECTOR}'s health")
    return int(health["injections accepted"])
