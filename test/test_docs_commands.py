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
import os
import re
import shlex
import signal
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
import yaml
from bag_helpers import cut_copy, messages, write_messages
from conftest import StartProcess
from docs_helpers import ALL, EXAMPLES, PAGES, Command, blocks, commands, saved_files, table
from test_layers import ROOT

from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line import errors
from ppc_attitude.command_line.main import COMMANDS, build_parser, main
from ppc_attitude.command_line.options import scenario_of
from ppc_attitude.contract.parameters import PARAMETERS
from ppc_attitude.contract.topics import (
    BY_NAME,
    CONTROLLER,
    INJECTOR,
    PLANT,
    RECORDER,
    REFERENCE,
)
from ppc_attitude.science.parameter import resolved
from ppc_attitude.simulation.closed_loop import simulate

# Commands of other people's, as they stand on the pages: nothing of ours to check in them.
FOREIGN = re.compile(
    r"source (install/setup\.bash|\.venv/bin/activate)|export ROS_\w+=\S+|colcon (build|test)|"
    r"rosdep install --from-paths src --ignore-src -y|pip install -e '\.\[\w+(,\w+)*\]'|"
    r"export( ROS_\w+=\S+)+|ros2 security create_(keystore|enclave) keys( /\w+)?|"
    r"ros2 bag (info|play) bags/\S+|rviz2 -d config/ppc_attitude\.rviz"
)
# What these do needs a running stack: test_docs_stack.py and test_launch.py run them.
NEEDS_A_STACK = ("inject", "watch", "latency")
NEEDS_A_LAUNCH = ("bags/both",)


@pytest.mark.parametrize("command", ALL, ids=str)
def test_command_is_one_of_ours_or_well_known(command: Command) -> None:
    words = command.words
    if FOREIGN.fullmatch(command.text):
        return
    if words[0] == "ppc_attitude":
        parsed = parsed_by_us(words[1:])
        for config in getattr(parsed, "config", []):
            assert (ROOT / config).exists() or config.as_posix() in saved_files(command.page)
    elif words[0] == "ros2":
        check_ros2(words[1:])
    elif words[0] == "make":
        assert re.search(rf"^{words[1]}:", (ROOT / "Makefile").read_text(), re.MULTILINE)
    elif command.page.name == "CONTRIBUTING.md":
        return  # how the lower bounds are tested: minutes, and another Python
    elif words[:2] == ["python", "-m"]:
        assert find_spec(words[2]) is not None
        check_node_arguments(words[2].rpartition(".")[2], words[3:])
    elif words[0] == "python":
        assert (ROOT / words[1]).is_file()
    else:
        pytest.fail(f"nobody checks this command: {command}")


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


def test_make_run_is_the_papers_case() -> None:
    """Make may print its recipe wherever it stands; what it starts is the command of the README."""
    shown = subprocess.run(
        ["make", "--dry-run", "--always-make", "run"], cwd=ROOT, capture_output=True, text=True
    )
    assert shown.returncode == 0, shown.stderr
    (line,) = re.findall(r"ppc_attitude (run .*?) \|\|", shown.stdout)
    parsed = build_parser().parse_args(shlex.split(line))
    assert [str(path) for path in parsed.config] == ["config/paper.yaml"]
    assert parsed.report == Path("build/paper.html")


def parsed_by_us(arguments: list[str]) -> argparse.Namespace:
    """Parse as the command does; a usage error fails the test."""
    try:
        return build_parser().parse_args([each for each in arguments if each != "pd"])
    except SystemExit:
        if "pd" in arguments:  # the third controller is not registered here
            return build_parser().parse_args(["simulate"])
        raise


def check_ros2(words: list[str]) -> None:
    """Executables, topics, types, services and parameters exist, and values are allowed."""
    if words[:2] == ["run", "ppc_attitude"]:
        check_node_arguments(words[2], words[3:])
    elif words[:2] == ["launch", "ppc_attitude"]:
        assert (ROOT / "launch" / words[2]).is_file()
    elif words[:3] == ["topic", "pub", "--once"]:
        assert BY_NAME[words[3].lstrip("/")].msgtype == words[4]
        assert isinstance(yaml.safe_load(words[5]), dict)
    elif words[:2] == ["param", "set"]:
        check_parameter(words[2].lstrip("/"), words[3], words[4])
    elif words[:2] == ["service", "call"]:
        rows = {f"/{row[0]}": row[1] for row in table(ROOT / "docs/reference.md", "| service |")}
        assert rows[words[2]] == words[3].replace("/srv/", "/")
        assert isinstance(yaml.safe_load(words[4]), dict)
    else:
        pytest.fail(f"nobody checks ros2 {shlex.join(words)}")


def check_node_arguments(node: str, words: list[str]) -> None:
    """Check the ROS arguments of a node's command line."""
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
    """The node has the parameter and takes the value."""
    resolved(PARAMETERS[node], {name: yaml.safe_load(value)}, node)


def simulated_run(arguments: list[str]) -> int:
    """Stand in for `run`: simulate its configuration and leave the bag that it would leave."""
    parsed = build_parser().parse_args(["run", *arguments])
    scenario = scenario_of(parsed)
    record = simulate(scenario, float(str(scenario.parameters[PLANT]["duration"])))
    bag = parsed.bag or Path("bags") / "dated"
    bag.parent.mkdir(exist_ok=True)
    write_messages(bag, list(messages(record)), run=record)
    return main(["analyse", str(bag)])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["README.md", "tutorial.md", "how-to.md"])
def test_commands_of_a_page_run_in_their_order(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = next(each for each in PAGES if each.name == name)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "build").mkdir()
    (tmp_path / "config").symlink_to(ROOT / "config")
    for path, content in saved_files(page).items():
        (tmp_path / path).write_text(content, encoding="utf-8")
    ours = [each for each in commands(page) if each.words[0] == "ppc_attitude"]
    if name == "how-to.md":  # it works with the bag of the tutorial
        hit = ["--config", "config/sudden_disturbance.yaml", "--bag", "bags/hit"]
        simulated_run(["--config", "config/paper.yaml", *hit])
        cut_copy(Path("bags/hit"), Path("bags/cut"), 1_000_000)
    codes = {}
    for command in ours:
        arguments = command.words[1:]
        if {arguments[0], *arguments} & {*NEEDS_A_STACK, *NEEDS_A_LAUNCH, "pd"}:
            continue
        if find_spec("pyarrow") is None and {arguments[0], *arguments} & {"campaign", "--parquet"}:
            continue
        code = simulated_run(arguments[1:]) if arguments[0] == "run" else main(arguments)
        codes[command.text] = code
        assert "error:" not in capsys.readouterr().err
    assert codes
    fails = ("no_widening", "traditional", "longer", "campaign")
    for text, code in codes.items():
        expected = any(each in text for each in fails) and " compare " not in text
        assert code == (errors.REQUIREMENT_FAILED if expected else errors.DONE), text


def test_third_controller_is_one_file_and_one_line(tmp_path: Path) -> None:
    script = (
        "import runpy, sys\n"
        "from ppc_attitude.science.controllers import registry\n"
        f"law = runpy.run_path({str(EXAMPLES / 'pd.py')!r})['CONTROLLER']\n"
        "registry.CONTROLLERS[law.name] = law\n"
        "from ppc_attitude.command_line.main import main\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    arguments = ["simulate", "--config", "config/paper.yaml", "--controller", "pd", "--json"]
    done = subprocess.run(
        [sys.executable, "-c", script, *arguments],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120.0,
    )
    assert done.returncode == errors.REQUIREMENT_FAILED, done.stderr
    metrics = json.loads(done.stdout)["metrics"]
    text = (ROOT / "docs/tutorial.md").read_text(encoding="utf-8")
    said = re.search(
        r"settles in (\S+) s, at (\S+)°/s, and the environment torque leaves it (\S+) off", text
    )
    assert said is not None
    reached = ("settling_time_s", "max_rate_deg_s", "terminal_error")
    for number, name in zip(said.groups(), reached, strict=True):
        assert float(number) == pytest.approx(metrics[name], rel=0.02)


@pytest.mark.ros
def test_own_controller_joins_in_lockstep(start_process: StartProcess, tmp_path: Path) -> None:
    (line,) = (c for c in ALL if "wait_for:=" in c.text)
    bag = tmp_path / "bag"
    module = "ppc_attitude.nodes."
    recorder = start_process(
        [sys.executable, "-m", f"{module}bag_recorder", "--ros-args", "-p", f"bag:={bag}"]
    )
    controller = start_process([sys.executable, str(EXAMPLES / "own_controller.py")])
    # Paced, so that the recorder finds the plant while it runs; where it begins does not matter.
    paced = [*line.words[4:], "-p", "real_time_factor:=20.0"]
    plant = start_process([sys.executable, "-m", f"{module}spacecraft_plant", *paced])
    assert plant.wait(timeout=60.0) == 0
    for process in (controller, recorder):
        process.send_signal(signal.SIGINT)
        process.wait(timeout=30.0)
    # A plain publisher keeps nothing for a recorder that comes late: what it sent then is there.
    assert any(row.any() for row in read_run(bag)["torque_command"])
    rates = recorded_rates(bag)
    assert max(map(abs, rates[0])) > 1e-3
    assert max(map(abs, rates[-1])) < 1.01e-4  # there the command is in the actuator's dead band


@pytest.mark.ros
def test_a_run_started_by_hand_is_recorded_from_its_first_instant(
    start_process: StartProcess, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (block,) = (b for b in blocks(ROOT / "docs/how-to.md", "bash") if "wait_for_recorder" in b)
    lines = {words[2].rpartition(".")[2]: words for words in map(shlex.split, block.splitlines())}
    assert set(lines) == {RECORDER, REFERENCE, INJECTOR, PLANT}
    (tmp_path / "config").symlink_to(ROOT / "config")

    def start(command: list[str]) -> subprocess.Popen[str]:
        return start_process([sys.executable, *command], cwd=tmp_path)

    # One that was told of a controller of ours misses what it would send.
    info = json.dumps({"parameters": {PLANT: {}, CONTROLLER: {"controller": "ppc"}}})
    told = ["-p", f"run_info:={info!r}"]
    misled = start_process(
        [sys.executable, *lines[RECORDER][1:-1], "bag:=misled", *told, "-r", "__node:=misled"],
        cwd=tmp_path,
    )
    recorder = start(lines[RECORDER][1:])
    peers = [start(lines[node][1:]) for node in (REFERENCE, INJECTOR)]
    peers.append(start([str(EXAMPLES / "own_controller.py")]))
    plant = start([*lines[PLANT][1:], "-p", "duration:=2.0"])
    assert plant.wait(timeout=60.0) == 0
    for process in (*peers, recorder, misled):
        process.send_signal(signal.SIGINT)
    _, said = recorder.communicate(timeout=30.0)
    assert recorder.returncode == errors.DONE, said
    run = read_run(tmp_path / "bags" / "own")
    assert (run.t[0], run.t[-1], run.missing_messages) == (0.0, 2.0, 0)
    assert "attitude_error" not in run
    assert main(["analyse", str(tmp_path / "bags" / "own")]) == errors.REQUIREMENT_FAILED
    assert "messages missing or not finite" in capsys.readouterr().out
    _, said = misled.communicate(timeout=30.0)
    assert misled.returncode == errors.BROKEN
    assert "is incomplete: control/attitude_error never came" in said


def recorded_rates(bag: Path) -> list[tuple[float, float, float]]:
    """Angular velocities of a bag, read with rosbags alone."""
    from rosbags.highlevel import AnyReader

    with AnyReader([bag]) as reader:
        links = [each for each in reader.connections if each.topic == "/angular_velocity"]
        vectors = [
            reader.deserialize(data, link.msgtype).vector
            for link, _, data in reader.messages(connections=links)
        ]
    return [(each.x, each.y, each.z) for each in vectors]


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
    _, said = plant.communicate(timeout=60.0)
    assert plant.returncode == 0, said
    for peer in peers:
        assert peer.poll() is None
