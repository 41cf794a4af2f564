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

"""Every command of the documentation runs, and so does its code."""

import argparse
import json
import re
import shlex
import signal
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import yaml
from bag_helpers import cut_copy
from campaign_helpers import compute_here
from conftest import Ask, StartProcess
from craft_helpers import ROOT
from docs_helpers import ALL, EXAMPLES, PAGES, Command, blocks, commands, saved_files, table
from process_helpers import PATIENCE, ran

from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line.main import COMMANDS, main, parsers
from ppc_attitude.contract.declared import BY_NAME
from ppc_attitude.contract.parameters import PARAMETERS
from ppc_attitude.contract.topics import INJECTOR, PLANT, RECORDER
from ppc_attitude.processes import exits
from ppc_attitude.science.parameter import resolved

# Words of the commands that need a running stack, the bag of a launch or of hardware, or the third
# controller.
NEEDS_MORE = {"inject", "watch", "latency", "goto", "bags/both", "bags/rig", "pd"}


def made_on(page: Path) -> set[str]:
    """Files that a page's own commands write: `--output FILE`."""
    words = [command.words for command in commands(page)]
    return {each[each.index("--output") + 1] for each in words if "--output" in each}


@pytest.mark.parametrize("command", ALL, ids=str)
def test_command_exists_with_its_arguments(command: Command) -> None:
    """Commands of others, such as `colcon build`, are not ours to check."""
    words = command.words
    if words[0] == "ppc_attitude":
        parsed = parsed_by_us(words[1:])
        for config in getattr(parsed, "config", []):
            assert (ROOT / config).exists() or config.as_posix() in {
                *saved_files(command.page),
                *made_on(command.page),
            }
    elif words[0] == "ros2":
        check_ros2(words[1:])
    elif words[0] == "make":
        ran(["make", "--dry-run", words[1]], cwd=ROOT)
    elif words[:2] == ["python", "-m"]:
        assert find_spec(words[2]) is not None
        check_node_arguments(words[2].rpartition(".")[2], words[3:])
    elif words[0] == "python":
        assert (ROOT / words[1]).is_file()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_in_the_text_are_those_of_the_parser(page: Path) -> None:
    """`ppc_attitude COMMAND …`; NAMES in capitals stand for values."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    for line in re.findall(r"`(ppc_attitude [^`]+)`", text):
        words = shlex.split(line)[1:]
        if words[0] == "COMMAND":
            continue
        assert words[0] in COMMANDS, line
        if len(words) > 1:
            parsed_by_us(words)
    for line in re.findall(r"`(ros2 service call [^`]+)`", text):
        check_ros2(shlex.split(line)[1:])


def test_make_run_is_the_papers_case() -> None:
    """Make may print its recipe wherever it stands; what it starts is the command of the README."""
    shown = ran(["make", "--dry-run", "--always-make", "run"], cwd=ROOT).stdout
    (line,) = re.findall(r"ppc_attitude (run .*)", shown)
    parsed = parsers()[0].parse_args(shlex.split(line.replace("$PWD", str(ROOT))))
    assert [str(path) for path in parsed.config] == ["config/paper.yaml"]
    assert parsed.report == ROOT / "build" / "paper.html"


def parsed_by_us(arguments: list[str]) -> argparse.Namespace:
    """Parse as the command does; a usage error fails the test."""
    # The third controller is not registered here.
    return parsers()[0].parse_args(["ppc" if each == "pd" else each for each in arguments])


def check_ros2(words: list[str]) -> None:
    """Executables, topics, types, services and parameters exist, and values are allowed."""
    if words[:2] == ["run", "ppc_attitude"]:
        check_node_arguments(words[2], words[3:])
    elif words[:2] == ["launch", "ppc_attitude"]:
        assert (ROOT / "launch" / words[2]).is_file()
    elif words[:3] == ["topic", "pub", "--once"]:
        topic, msgtype, content = words[-3:]
        assert BY_NAME[topic.lstrip("/")].msgtype == msgtype
        package, _, name = msgtype.replace("/", ".").rpartition(".")
        fill(getattr(import_module(package), name)(), yaml.safe_load(content))
    elif words[:2] == ["param", "set"]:
        node, name, value = words[2].lstrip("/"), *words[3:]
        check_parameter(node, name, value)
        assert not any(each.read_only for each in PARAMETERS[node] if each.name == name)
    elif words[:2] == ["service", "call"]:
        rows = {f"/{row[0]}": row[1] for row in table(ROOT / "docs/reference.md", "| service |")}
        assert rows[words[2]] == words[3].replace("/srv/", "/")
        assert isinstance(yaml.safe_load(words[4]), dict)


def fill(message: Any, values: dict[str, Any]) -> None:
    """Set the fields that are given; a message refuses what it has not."""
    for name, value in values.items():
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        else:
            setattr(message, name, value)


def check_node_arguments(node: str, words: list[str]) -> None:
    assert node in PARAMETERS
    assert words == [] or words[0] == "--ros-args"
    for option, value in zip(words[1::2], words[2::2], strict=True):
        if option == "--params-file":
            assert (ROOT / value).is_file()
        elif option == "-p":
            check_parameter(node, *value.split(":=", 1))
        else:
            assert option == "-r"
            assert ":=" in value


def check_parameter(node: str, name: str, value: str) -> None:
    resolved(PARAMETERS[node], {name: yaml.safe_load(value)}, node)


def simulated(arguments: list[str]) -> int:
    """Stand in for `run`, whose options `simulate` takes but for how time passes."""
    parsers()[0].parse_args(["run", *arguments])
    return main(["simulate", *(each for each in arguments if each != "--realtime")])


def shortened(arguments: list[str]) -> list[str]:
    """The command with gains in place of the search that finds them, and with few runs."""
    if arguments[0] == "design" and "--gains" not in arguments:
        return [*arguments, "--gains", "0.4", "88.35", "1"]
    if "--runs" in arguments:
        return [*arguments, "--runs", "3", "--workers", "1"]
    return arguments


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")  # that it draws is test_figures'
@pytest.mark.parametrize(
    ("name", "as_written"),
    [
        ("README.md", False),
        ("how-to.md", False),
        *(
            pytest.param(name, True, marks=pytest.mark.long)
            for name in ("README.md", "tutorial.md", "how-to.md")
        ),
    ],
)
def test_commands_of_a_page_run_in_their_order(
    name: str,
    as_written: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    request: pytest.FixtureRequest,
) -> None:
    page = next(each for each in PAGES if each.name == name)
    if not as_written:
        request.getfixturevalue("coarse")
        compute_here(monkeypatch)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "build").mkdir()
    (tmp_path / "config").symlink_to(ROOT / "config")
    for path, content in saved_files(page).items():
        (tmp_path / path).write_text(content, encoding="utf-8")
    ours = [each for each in commands(page) if each.words[0] == "ppc_attitude"]
    if name == "how-to.md":  # it works with the bag of the tutorial
        hit = ["--config", "config/sudden_disturbance.yaml", "--bag", "bags/hit"]
        simulated(["--config", "config/paper.yaml", "--duration", "10", *hit])
        cut_copy(Path("bags/hit"), Path("bags/cut"), 1_000_000)
    codes = {}
    for command in ours:
        arguments = command.words[1:]
        if NEEDS_MORE.intersection(arguments):
            continue
        if find_spec("pyarrow") is None and {"campaign", "--parquet"}.intersection(arguments):
            continue
        if not as_written:
            arguments = shortened(arguments)
        code = simulated(arguments[1:]) if arguments[0] == "run" else main(arguments)
        codes[command.text] = code
        assert "error:" not in capsys.readouterr().err
    assert codes
    fails = ("no_widening", "traditional", "longer", "campaign")
    for text, code in codes.items():
        expected = any(each in text for each in fails) and " compare " not in text
        assert code == (exits.REQUIREMENT_FAILED if expected else exits.DONE), text


def test_third_controller_is_one_file_and_one_line() -> None:
    script = (
        "import sys\n"
        "from ppc_attitude.science.kinds import CONTROLLERS\n"
        "import pd\n"
        "CONTROLLERS.components[pd.COMPONENT.name] = pd.COMPONENT\n"
        "from ppc_attitude.command_line.main import main\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    arguments = ["simulate", "--config", "config/paper.yaml", "--controller", "pd", "--json"]
    command = [sys.executable, "-c", script, *arguments]
    search = {"PYTHONPATH": str(EXAMPLES)}
    done = ran(command, exits.REQUIREMENT_FAILED, env=search, cwd=ROOT)
    metrics = json.loads(done.stdout)["metrics"]
    text = (ROOT / "docs/tutorial.md").read_text(encoding="utf-8")
    said = re.search(
        r"settles in (\S+) s and reaches (\S+)°/s, and the environment torque leaves it (\S+) off",
        text,
    )
    assert said is not None
    reached = ("settling_time_s", "max_rate_deg_s", "terminal_error")
    for number, name in zip(said.groups(), reached, strict=True):
        assert float(number) == pytest.approx(metrics[name], rel=0.02)


@pytest.mark.ros
@pytest.mark.long
def test_a_run_started_by_hand_is_recorded_from_its_first_instant(
    start_process: StartProcess, tmp_path: Path, ask: Ask
) -> None:
    (block,) = (b for b in blocks(ROOT / "docs/how-to.md", "bash") if "wait_for_recorder" in b)
    lines = {words[2].rpartition(".")[2]: words for words in map(shlex.split, block.splitlines())}
    assert set(lines) == {RECORDER, INJECTOR, PLANT}
    (tmp_path / "config").symlink_to(ROOT / "config")

    def start(command: list[str]) -> subprocess.Popen[str]:
        return start_process([sys.executable, *command], cwd=tmp_path)

    recorder = start(lines[RECORDER][1:])
    peers = [start(lines[INJECTOR][1:]), start([str(EXAMPLES / "own_controller.py")])]
    assert recorder.stderr is not None
    assert any("parameters of /rate_damper are on record" in line for line in recorder.stderr)
    plant = start([*lines[PLANT][1:], "-p", "duration:=2.0"])
    assert plant.wait(timeout=PATIENCE) == 0
    for process in (*peers, recorder):
        process.send_signal(signal.SIGINT)
    _, said = recorder.communicate(timeout=PATIENCE)
    assert recorder.returncode == exits.DONE, said
    run = read_run(tmp_path / "bags" / "own")
    assert (run.t[0], run.t[-1], run.missing_messages) == (0.0, 2.0, 0)
    assert "attitude_error" not in run
    assert any(row.any() for row in run["torque_command"])
    told = ask("analyse", tmp_path / "bags" / "own").out
    assert "messages missing or not finite" in told


@pytest.mark.ros
def test_own_plant_is_controlled(start_process: StartProcess) -> None:
    (block,) = (b for b in blocks(ROOT / "docs/how-to.md", "bash") if "own_plant.py" in b)
    *lines, last = (shlex.split(line) for line in block.splitlines())
    peers = [start_process([sys.executable, *words[1:]]) for words in lines]
    assert len(peers) == 2
    assert last[1] == "docs/examples/own_plant.py"
    plant = start_process(
        [sys.executable, str(EXAMPLES / "own_plant.py"), "--ros-args", "-p", "steps:=100"]
    )
    _, said = plant.communicate(timeout=PATIENCE)
    found = re.search(r"100 states, (\d+) torques", said)
    assert found and int(found[1]) > 0, said  # a busy machine may answer few: the plant goes on
    for peer in peers:
        assert peer.poll() is None
