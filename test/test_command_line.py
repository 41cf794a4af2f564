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

"""Every command helps, and tells a user's mistake in one line."""

import gc
import os
import shlex
import sys
import warnings
from argparse import ArgumentTypeError
from importlib import import_module
from pathlib import Path

import pytest
from bag_helpers import assert_flown
from conftest import Ask
from craft_helpers import overlay
from process_helpers import COMMAND, PAPER, ran
from synthetic import normal_run

import ppc_attitude
from ppc_attitude.analysis.drawing import RUN_COLOURS
from ppc_attitude.bags.reader import read_run
from ppc_attitude.bags.run_writer import write_run
from ppc_attitude.command_line.gain_search import WRITTEN
from ppc_attitude.command_line.main import COMMANDS, main, parsers
from ppc_attitude.command_line.options import REPORT
from ppc_attitude.command_line.paths import new_file, new_folder
from ppc_attitude.command_line.recording import _progress
from ppc_attitude.contract.topics import RECORDER
from ppc_attitude.processes.exits import BAD_INPUT


def examples(command: str) -> tuple[str, ...]:
    found: tuple[str, ...] = import_module(f"ppc_attitude.command_line.commands.{command}").EXAMPLES
    return found


def test_every_command_has_examples_that_parse() -> None:
    parser, commands = parsers()
    assert set(COMMANDS) == set(commands.choices)
    for command in COMMANDS:
        for line in examples(command):
            words = [word for word in shlex.split(line) if not word.startswith("ROS_DOMAIN_ID=")]
            assert words[:2] == ["ppc_attitude", command]
            assert parser.parse_args(words[1:]).command == command


@pytest.mark.parametrize("command", COMMANDS)
def test_help_describes_every_argument(command: str, ask: Ask) -> None:
    shown = ask(command, "--help").out
    for line in examples(command):
        assert f"\n  {line}\n" in shown
    for action in parsers()[1].choices[command]._actions:
        assert action.help, f"{command}: {action.dest}"


def test_version(ask: Ask) -> None:
    assert ask("--version").out == f"ppc_attitude {ppc_attitude.__version__}\n"


def test_garbage_is_collected_again_when_a_command_is_executed(ask: Ask) -> None:
    gc.disable()  # as `run` does
    try:
        ask("recover", "no_bag", code=BAD_INPUT)
        assert gc.isenabled()
    finally:
        gc.enable()
        gc.unfreeze()


def test_the_general_help_names_every_command(ask: Ask) -> None:
    shown = ask("--help").out
    assert all(f"    {command} " in shown for command in COMMANDS)
    assert "exit codes" in shown


@pytest.fixture
def mistakes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run where the files of the wrong invocations are."""
    files = {
        "unknown_node.yaml": "/**/plant:\n  ros__parameters: {rate: 1.0}\n",
        "steers.yaml": '"\\e[2J": 1\n',
        "month.yaml": "/**/ppc_controller:\n  ros__parameters: {k: 2020-13-01}\n",
        "a_file": "not a bag",
        "own.png": "a letter",
        "own.html": "<!DOCTYPE html>\n<title>mine</title>",
        "own.yaml": "/**/spacecraft_plant:\n  ros__parameters: {rate: 50.0}\n",
        "searched/worst.yaml": "/**/spacecraft_plant: {}\n",
        "taken/metadata.yaml": "rosbag2_bagfile_information: 3\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    (tmp_path / "empty").mkdir()
    (tmp_path / "link").symlink_to("nowhere")
    monkeypatch.chdir(tmp_path)
    return tmp_path


WRONG = [
    ("", "COMMAND"),
    ("fly", "invalid choice: 'fly'"),
    ("run --speed 3", "unrecognized arguments: --speed 3 (see ppc_attitude run --help)"),
    ("run --config", "--config"),
    ("run --config empty", "empty"),
    ("run --config unknown_node.yaml", "plant"),
    ("simulate --config steers.yaml", r"steers.yaml: control characters in '\x1b[2J'"),
    ("simulate --config month.yaml", "month.yaml cannot be read as YAML: month must be in 1..12"),
    ("run --duration nan", "nan"),
    ("run --duration soon", "soon"),
    ("run --controller pid", "pid"),
    ("run --bag taken", "taken exists already"),
    ("run --bag a_file/bag", "a_file is no folder"),
    ("simulate --bag link", "link is no folder"),
    ("analyse taken --report link/page.html", "link is no folder"),
    ("run --report taken", "taken is a folder"),
    ("simulate --report ''", "the path is empty"),
    ("simulate --bag taken", "taken exists already"),
    ("simulate --export a_file", "a_file exists already"),
    ("simulate --export table.xlsx", ".csv or .parquet"),
    ("simulate --config own.yaml --report new.yaml", "new.yaml: allowed are files"),
    ("simulate --config own.yaml --report own.yaml", "own.yaml exists already and does not say"),
    ("simulate --report own.html", "own.html exists already and does not say"),
    ("analyse taken --report taken/metadata.yaml", "taken/metadata.yaml exists already"),
    ("simulate --export r.csv --report r.csv", "r.csv: allowed are files that end in .html"),
    ("simulate --bag a.csv --export a.csv", "bag = a.csv; allowed: another path than that of --ex"),
    ("run --bag r.html --report empty/../r.html", "bag = r.html; allowed: another path than that"),
    ("simulate --export a.csv --report a.csv/r.html", "report = a.csv/r.html; allowed: another"),
    ("campaign --out o.html/o --report o.html", "out = o.html/o; allowed: another path than that"),
    ("analyse none --figures f.html --report f.html", "figures = f.html; allowed: another path"),
    ("compare none none --figures f.html --report f.html", "figures = f.html; allowed: another"),
    ("simulate --config ''", "argument --config: the path is empty"),
    ("design --output own.yaml", "own.yaml exists already and does not say"),
    ("design --output new", "new: allowed are files that end in .yaml"),
    ("falsify --seed -1", "argument --seed: -1; allowed: an integer, ≥ 0"),
    ("falsify --pieces 10000", "argument --pieces: 10000; allowed: an integer, ≥ 0, ≤ 1000"),
    (
        "falsify --start-rate -1",
        "argument --start-rate: -1; allowed: finite, ≥ 0, ≤ 5000 deg/s",
    ),
    ("falsify --disturbance nan", "argument --disturbance: nan; allowed: finite, ≥ 0"),
    ("falsify --duration 5 --after 5", "--after 5 s; allowed: less than the run of 5 s"),
    ("falsify --after 1", "--after is for the goal rate and those with a bound; else it has no"),
    ("falsify --goal terminal --after 1", "--after is for the goal rate and those with a bound"),
    ("falsify --goal rate --accuracy 0.1", "--accuracy is for the goals settling and terminal"),
    ("falsify --pieces 0 --disturbance 0.01", "--disturbance is for a disturbance in pieces"),
    ("falsify --out searched", "searched/worst.yaml exists already and does not say"),
    ("sweep --figure x.xyz", "x.xyz: allowed are files that end in .png or .svg or .pdf"),
    ("sweep --figure own.png", "own.png exists already and does not say"),
    *(
        (f"analyse taken --topic {wrong}", "allowed: OURS=THEIRS, as in attitude=/imu/data")
        for wrong in ("attitude", "=/imu", "attitude=")
    ),
    ("simulate --duration 0", "0; allowed: finite, > 0"),
    ("simulate --duration 1e8", "1e+10 instants need "),
    ("run --duration 1e8", "duration = 1e+08 s at 100 Hz"),
    ("sweep --duration 1e8", "1e+10 instants need "),
    ("campaign --duration 1e8 --runs 9", "1e+10 instants need "),
    ("falsify --duration 1e8", "1e+10 instants need "),
    ("design --controller ppc --duration 1e8", "1e+10 instants need "),
    ("analyse none", "none"),
    ("analyse taken", "taken"),
    ("analyse taken --json --namespace /x", "taken"),
    ("analyse taken --figures a_file", "a_file is no folder"),
    ("compare", "BAG"),
    ("compare none", "none"),
    ("compare taken empty --figures here", "taken"),
    ("sweep --at soon", "soon"),
    ("sweep --config none.yaml", "none.yaml"),
    ("sweep --at 100 --duration 50", "--duration 50 s; allowed: more than 101 s"),
    ("design --controller ppc --duration 50", "duration = 50 s; allowed: ≥ 60 s, the settling d"),
    ("campaign --campaign none.yaml --runs 1", "none.yaml: No such file"),
    ("campaign --out a_file/out", "a_file is no folder"),
    ("campaign --runs 0", "error: argument --runs: 0; allowed: an integer, ≥ 1"),
    ("campaign --seed -1", "argument --seed: -1; allowed: an integer, ≥ 0"),
    ("campaign --record", "--only INDEX"),
    ("campaign --bag b", "--only INDEX"),
    ("campaign --only 1 --out o", "--out is for several runs, without --only"),
    ("campaign --scheduler a --workers 2", "--workers is for processes of this machine, without"),
    ("campaign --mission Europa", "--mission is for a report: --report FILE.html"),
    ("run --mission Europa", "--mission is for a report"),
    ("analyse none --figure-format svg", "--figure-format is for figures: --figures DIR"),
    ("compare none none --figure-format svg", "--figure-format is for figures: --figures DIR"),
    ("check --hit 0.5 1", "--hit is for a law with a certificate: momentum_tube or"),
    ("check --known-reference", "--known-reference is for a law with a certificate"),
    ("design --gains 1 15 0.2 --requirements own.yaml", "--requirements is for a search: --contr"),
    ("design --seconds 5", "--seconds is for a search: --controller ppc or quaternion_feedback"),
    ("design --controller ppc --gains 1 15 0.2", "--gains is for momentum_tube"),
    ("design --controller ppc --campaign own.yaml --rate 0", "--rate is for a search"),
    ("design --assume abc", "abc: allowed is NAME=VALUE with a NAME of dead_band"),
    ("design --assume eta=abc", "argument --assume: eta = abc; allowed: finite"),
    ("design --accuracy 5", "argument --accuracy: 5; allowed: finite, ≥ 1e-09, ≤ 1"),
    ("latency --live --config own.yaml", "--config is for a stack of its own, without --live"),
    ("latency --namespace a", "--namespace is for a stack that runs: --live"),
    ("watch --timeout 5", "--timeout is for one picture: --once"),
    ("replay none", "none"),
    ("inject", "X, Y, Z"),
    ("inject 1 2", "Z"),
    ("inject 1 2 x", "argument Z: x; allowed: finite"),
    ("inject 0 -inf 0", "argument Y: -inf; allowed: finite"),
    ("inject 1 0 0 --duration -1", "-1"),
    ("inject 1 0 0 --at 1e300", "argument --at: 1e300; allowed: finite, ≥ 0, ≤ 1e+08 s"),
    ("goto --euler 0 0 9 --at 3e9", "argument --at: 3e9; allowed: finite, ≥ 0"),
    ("goto --euler nan 0 0 --at 5", "argument --euler: nan; allowed: finite"),
    ("inject 1 0 0 --namespace a-b", "a-b"),
    ("watch --once --timeout never", "never"),
    ("watch --once --namespace a-b", "error: namespace 'a-b': "),
    ("simulate --bag b\udce4g", r"argument b\udce4g; allowed: text in UTF-8"),
    ("recover none", "none"),
    ("export taken", "--parquet"),
    ("export none --csv out.csv", "none"),
    ("export taken --csv a_file", "a_file exists already"),
    ("export taken --csv x.csv --parquet x.parquet", "not allowed with"),
]


@pytest.mark.parametrize(("line", "named"), WRONG, ids=[line or "(none)" for line, _ in WRONG])
def test_a_mistake_is_told_in_one_line(
    line: str, named: str, mistakes: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    before = sorted(mistakes.rglob("*"))
    try:
        code: object = main(shlex.split(line))
    except SystemExit as end:
        code = end.code
    out, err = capfd.readouterr()
    assert code == BAD_INPUT, err
    assert out == ""
    assert err.startswith("error: ")
    assert err.count("\n") == 1, err
    assert named in err
    assert sorted(mistakes.rglob("*")) == before, "a wrong call left something behind"


def test_where_nothing_can_be_written_is_told_before_the_work(
    mistakes: Path, monkeypatch: pytest.MonkeyPatch, ask: Ask
) -> None:
    """Root may write anywhere, so the kernel's answer is replaced."""
    asked = []

    def access(path: Path, mode: int) -> bool:
        asked.append((path, mode))
        return False

    monkeypatch.setattr(os, "access", access)
    told = ask("run", "--report", "new/report.html", code=BAD_INPUT).err
    assert f"nothing can be written into {mistakes}" in told
    assert asked == [(mistakes, os.W_OK | os.X_OK)]


def test_of_a_folder_that_exists_it_counts_whether_it_is_writable_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setattr(os, "access", lambda path, mode: path == home)
    assert new_folder(str(home)) == home
    assert new_file()(str(home / "file")) == home / "file"
    for written, parse in ((tmp_path, new_folder), (tmp_path / "file", new_file())):
        with pytest.raises(ArgumentTypeError, match="nothing can be written"):
            parse(str(written))
    with pytest.raises(ArgumentTypeError, match="nothing can be written into /"):
        new_folder("/")


@pytest.mark.parametrize("loss", ["chmod 0", "rmdir"])
def test_a_command_needs_no_folder_to_stand_in(loss: str, tmp_path: Path) -> None:
    """Nor is that folder entered by who runs as another user where root stands."""
    bounded = ["setpriv", "--bounding-set=-all", "--inh-caps=-all"] if os.geteuid() == 0 else []
    command = ["bash", "-c", f'{loss} "$PWD"; exec "$@"', "bash", *bounded, *COMMAND]
    (tmp_path / "stand").mkdir()
    ran([*command, "check", "--config", str(PAPER)], cwd=tmp_path / "stand")


def test_a_current_folder_that_is_gone_is_named(tmp_path: Path) -> None:
    command = ["bash", "-c", 'rmdir "$PWD"; exec "$@"', "bash", *COMMAND, "simulate"]
    done = ran([*command, "--bag", "bag"], code=2, cwd=tmp_path)
    assert done.stderr == "error: .: No such file or directory\n"


@pytest.mark.parametrize("line", ["inject 1 0 0", "run --duration 1", "latency --duration 1"])
def test_without_ros_one_line_says_what_is_missing_and_what_to_do(
    line: str, mistakes: Path, monkeypatch: pytest.MonkeyPatch, ask: Ask
) -> None:
    for name in ("inject", "visiting"):  # what was imported before would not miss it
        monkeypatch.delitem(sys.modules, f"ppc_attitude.nodes.{name}", raising=False)
    monkeypatch.setitem(sys.modules, "rclpy", None)
    before = sorted(mistakes.rglob("*"))
    told = ask(*line.split(), code=BAD_INPUT).err
    assert told.startswith("error: this command needs rclpy, which is not installed: source")
    assert told.count("\n") == 1
    assert sorted(mistakes.rglob("*")) == before


@pytest.mark.parametrize("word", ["-1", "-1e-3", "-.5e1", "-1E+2"])
def test_a_negative_number_is_no_option_however_it_is_written(word: str) -> None:
    parsed = parsers()[0].parse_args(["inject", "0", word, "0", "--at", "1e1"])
    assert (parsed.y, parsed.at) == (float(word), 10.0)
    parsed = parsers()[0].parse_args(["goto", "--euler", "0", word, "0"])
    assert parsed.euler == [0.0, float(word), 0.0]


def test_the_bar_of_a_run_ends_at_its_end(capsys: pytest.CaptureFixture[str]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # as the bar's own, of what is beyond its end
        with _progress(0.3) as show:
            for t in (0.1, 0.2, 0.1, 0.3 + 1e-12):
                show(t)
    assert "100%" in capsys.readouterr().err


def test_as_many_runs_are_compared_as_there_are_colours(tmp_path: Path, ask: Ask) -> None:
    assert len(RUN_COLOURS) == 6
    write_run(normal_run(duration=0.1), tmp_path / "bag")
    refused = ask("compare", tmp_path / "bag", code=BAD_INPUT).err
    assert refused == "error: the bags hold 1 runs; allowed: 2 to 6\n"


@pytest.mark.ros
def test_simulate_writes_what_run_would(recorded_bag: Path, tmp_path: Path, ask: Ask) -> None:
    bag, table = tmp_path / "bag", tmp_path / "run.csv"
    simulate = ["simulate", "--duration", 2]
    told = ask(*simulate, "--bag", bag, "--export", table).out
    assert f"bag: {bag}\ntable: {table}\n" in told
    written = read_run(bag, whole=True)
    assert_flown(written, read_run(recorded_bag))
    assert "command" in written.metadata
    assert len(table.read_text().splitlines()) == 202
    for output in (["--bag", bag], ["--export", table]):  # neither is overwritten
        ask(*simulate, *output, code=BAD_INPUT)


@pytest.mark.usefixtures("undrawn", "coarse")
def test_outputs_go_to_new_folders_and_replace_only_what_the_command_wrote(
    tmp_path: Path, ask: Ask
) -> None:
    table, report = tmp_path / "new" / "run.csv", tmp_path / "page" / "run.html"
    report.parent.mkdir()
    report.write_text(f"<!DOCTYPE html>{REPORT} the one before")
    ask("simulate", "--duration", 1, "--report", report, "--export", table)
    assert table.exists()
    assert "the one before" not in report.read_text()
    gains = tmp_path / "gains" / "mine.yaml"
    design = ["design", "--config", PAPER, "--gains", 1, 15.4, 0.2, "--output", gains]
    ask(*design)
    assert new_file(".yaml", replaces=[WRITTEN])(str(gains)) == gains
    gains.with_suffix(".certificate.json").write_text("{}")  # of somebody else
    ask(*design, code=BAD_INPUT)
    assert gains.with_suffix(".certificate.json").read_text() == "{}"


def test_simulate_takes_the_storage_of_the_recorder(tmp_path: Path, ask: Ask) -> None:
    file = overlay(tmp_path / "sqlite.yaml", {RECORDER: {"storage": "sqlite3"}})
    bag = tmp_path / "bag"
    ask("simulate", "--config", file, "--duration", 0.1, "--bag", bag)
    assert [each.suffix for each in bag.iterdir() if each.suffix != ".yaml"] == [".db3"]
