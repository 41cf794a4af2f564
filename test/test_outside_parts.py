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

"""Parts from a package of somebody else's go through loop, nodes, bag, replay and report."""

import json
import math
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from campaign_helpers import rows_of
from conftest import Answer
from craft_helpers import CONFIG
from outside_helpers import OUTSIDE, POINTS, name_points, package
from process_helpers import PATIENCE

from ppc_attitude.contract.topics import INJECTOR

FILES = [str(CONFIG / "paper.yaml"), str(OUTSIDE / "outside.yaml")]
PAPER, CONFIGS = f"--config {FILES[0]}", " ".join(f"--config {file}" for file in FILES)
OWN = {
    "ring_momentum",
    "rounded_attitude",
    "rounded_rate",
    "rate_change",
    "turned",
    "environment_torque",
    "torque_use",
}
Tell = Callable[..., Answer]


# Runs each command that it reads, in the folder and domain that come with it; two are of its own.
EACH = """
import json, os, shlex, sys
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from compare import compare
from ppc_attitude.command_line.main import main
from ppc_attitude.contract.versions import versions
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import load

def captions(*files):
    from ppc_attitude.analysis.figures import _drawings
    drawings = _drawings(simulate(load(files), 0.1))
    print(*(caption for _, caption, _ in drawings), versions(), sep="\\n")
    return 0

own = {"captions": captions, "compare": compare}
for line in sys.stdin:
    folder, domain, words = json.loads(line)
    os.chdir(folder)
    os.environ["ROS_DOMAIN_ID"] = domain
    out, err = StringIO(), StringIO()
    words = shlex.split(words)
    with redirect_stdout(out), redirect_stderr(err):
        code = own[words[0]](*words[1:]) if words[0] in own else main(words)
    print(json.dumps((code, out.getvalue(), err.getvalue())), flush=True)
"""
MISFITTING = {
    "sensors": ("failing", "hasty", "sure", "tilted"),
    "estimators": ("bounded", "quiet"),
    "controllers": ("beyond_column", "blind", "chatty", "enveloped", "listening", "margin"),
    "environments": ("gusty", "table"),
    "plants": ("unnamed", "unnamed_wheels"),
}
"""Parts that misfit while they run, beside those that fit."""


@pytest.fixture(scope="module")
def outside(tmp_path_factory: pytest.TempPathFactory) -> Iterator[subprocess.Popen[str]]:
    """Start a process for commands where all parts are installed, for they share what compiles."""
    folder = tmp_path_factory.mktemp("outside")
    environment = package(folder)
    points = {
        kind: "\n".join([POINTS[kind], *(f"{each} = misfits:{each}" for each in MISFITTING[kind])])
        for kind in MISFITTING
    }
    name_points(folder, **{**POINTS, **points})
    script = [sys.executable, "-c", EACH]
    pipes = dict.fromkeys(("stdin", "stdout"), subprocess.PIPE)
    with subprocess.Popen(script, env=environment, text=True, **pipes) as process:
        yield process
        process.stdin.close()


@pytest.fixture
def tell(outside: "subprocess.Popen[str]", tmp_path: Path) -> Tell:
    """Run a command there, in the folder of the test: what it prints, and its errors."""

    def run(words: str, code: int = 0) -> Answer:
        line = json.dumps((str(tmp_path), os.environ["ROS_DOMAIN_ID"], words))
        print(line, file=outside.stdin, flush=True)
        late = threading.Timer(PATIENCE, outside.kill)
        late.start()
        ended, *printed = json.loads(outside.stdout.readline())
        late.cancel()
        assert ended == code, printed
        return Answer(*printed)

    return run


def choose(tmp_path: Path, node: str, values: str, name: str = "own.yaml") -> None:
    (tmp_path / name).write_text(f"{node}: {{ros__parameters: {{{values}}}}}\n")


@pytest.mark.ros
@pytest.mark.slow
def test_parts_from_outside_go_all_the_way(tell: Tell, tmp_path: Path) -> None:
    tell(f"run {CONFIGS} --duration 1.3 --bag bag")
    columns, _, replay = tell(f"compare bag {' '.join(FILES)}").out.partition("\n")
    assert set(columns.split()) >= OWN
    replayed = json.loads(replay)
    assert {each["component"] for each in replayed["components"]} == {
        "ringed",
        "rounding",
        "two_rates",
        "turn",
        "share",
        "ideal",
        "pushes",
    }
    assert all(each["largest"] == 0.0 for each in replayed["components"])
    tell("export bag --csv table.csv")
    with (tmp_path / "table.csv").open(encoding="utf-8") as table:
        assert "ring_momentum_0,ring_momentum_1,ring_momentum_2" in table.readline()
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "share" in page


def test_an_advice_that_is_none_is_refused_before_anything_runs(tell: Tell) -> None:
    told = tell(f"simulate {PAPER} --controller chatty --duration 1", code=2)
    assert "component chatty: advice raised TypeError: 'well'; allowed: an Advice" in told.err


def test_who_reads_what_is_given_later_hears_what_is_allowed(tell: Tell, tmp_path: Path) -> None:
    choose(tmp_path, "spacecraft_plant", "sensors: hasty")
    told = tell("simulate --config own.yaml --duration 1", code=2)
    assert "reads torque_command, which is computed later in the step; allowed: col" in told.err


def test_a_report_tells_who_gives_a_bounded_column_and_the_version_of_its_package(
    tell: Tell, tmp_path: Path
) -> None:
    choose(tmp_path, "/**", "estimator: bounded")
    told = tell(f"captions {' '.join(FILES)} own.yaml").out
    assert "\nRate change in its envelope, as attitude_estimator reports it\n" in told
    assert "'outside_parts': '1.0'" in told


def test_the_law_is_checked_for_the_reference_that_is_selected(tell: Tell, tmp_path: Path) -> None:
    bounds = []
    for rate in (0.0, 0.01):
        turn = f"mode: turn, turn.rate: {rate}, amplitude: [0.5, 0.5, 0.5]"
        choose(tmp_path, "reference_generator", turn, f"turn{rate}.yaml")
        conditions = tell(f"check --config turn{rate}.yaml --json").json["conditions"]
        bounds += [each["value"] for each in conditions if each["name"] == "rate bound"]
    assert bounds[0] < 6.0
    assert bounds[1] - bounds[0] == pytest.approx(math.degrees(0.01))


def test_a_law_is_judged_by_its_own_bounds(tell: Tell, tmp_path: Path) -> None:
    given = f"{PAPER} --controller"
    run = f"simulate {given} {{}} --duration 1 --json"
    simulated = [tell(run.format(law), code).json for law, code in (("margin", 1), ("ppc", 0))]
    metrics = simulated[0]["metrics"]
    assert metrics["time_outside_attitude_envelope_s"] == 0.51
    assert metrics["time_pointing_outside_attitude_envelope_s"] == 0.51
    rows = [
        {
            each["name"]: (each["value"], each["pass"])
            for each in verdict["requirements"]
            if "outside its envelope" in each["name"]
        }
        for verdict in simulated
    ]
    assert rows[0] == {"attitude error outside its envelope": (0.51, False)}
    assert set(rows[1]) == {f"{which} error outside its envelope" for which in ("attitude", "rate")}
    choose(tmp_path, "ppc_controller", "controller: enveloped")
    captions = tell(f"captions {FILES[0]} own.yaml").out.splitlines()
    assert "Attitude error in its envelope, as ppc_controller reports it" in captions
    assert "True attitude error" in captions  # so the two are two files


def test_what_sensors_tell_is_judged_by_the_noise_that_they_declare(
    tell: Tell, tmp_path: Path
) -> None:
    choose(tmp_path, "spacecraft_plant", "sensors: tilted")
    verdict = tell(f"simulate {PAPER} --config own.yaml --duration 1 --json", code=1).json
    (row,) = [each for each in verdict["requirements"] if each["name"].startswith("knowledge")]
    assert row["limit"] == pytest.approx(math.degrees(8e-6))
    assert (row["value"], row["pass"]) == (pytest.approx(math.degrees(2e-4), rel=1e-3), False)


def test_a_sweep_and_an_adversary_know_the_envelopes_that_the_components_declare(
    tell: Tell, tmp_path: Path
) -> None:
    """Also one of an estimator, whatever the law."""
    choose(tmp_path, "/**", "estimator: bounded")
    given = f"sweep {CONFIGS} --config own.yaml --pulse-durations 0.1 --at 1 --duration 2"
    head = next(line for line in tell(given).out.splitlines() if line.startswith("hit [s]"))
    assert "z2 outside [s]  rate change outside [s]  verdict" in head
    (hit,) = tell(f"{given} --json").json["hits"]
    assert hit["time_outside_rate_envelope_s"] is None
    assert hit["time_outside_rate_limit_s"] > 0.0
    told = tell(f"falsify {CONFIGS} --config own.yaml --duration 1 --goal speed", code=2).err
    assert told.endswith("goal = speed; allowed for share: settling, terminal, rate, rate_change\n")


def test_check_takes_no_inertia_of_a_plant_that_does_not_run(tell: Tell, tmp_path: Path) -> None:
    choose(tmp_path, "spacecraft_plant", "plant: unnamed")
    goal = "mode: goal, goals.times: [1.0], goals.attitudes: [0.0, 0.0, 0.0, 1.0]"
    choose(tmp_path, "reference_generator", goal, "goal.yaml")
    paper = f"check {PAPER}"
    checks = [
        f"{each} {own}"
        for each in (paper, f"{paper} --config goal.yaml")
        for own in ("", "--config own.yaml")
    ]
    choose(tmp_path, "spacecraft_plant", "plant: unnamed_wheels", "wheeled.yaml")
    wheels = f"{paper} --config {CONFIG / 'wheels.yaml'}"
    told = "".join(tell(each).out for each in (*checks, wheels, f"{wheels} --config wheeled.yaml"))
    assert told.count("torque authority") == 6
    assert told.count("speed of a wheel") == 1
    assert told.count("last goal") == 2
    assert told.count("time to turn") == 2
    assert told.count("slew torque") == 1


def test_a_campaign_draws_nothing_of_parts_that_do_not_run(tell: Tell, tmp_path: Path) -> None:
    choose(tmp_path, "spacecraft_plant", "plant: unnamed")
    (tmp_path / "one.yaml").write_text("campaign: {rate_noise: 1e-6}\n")
    campaign = f"campaign {PAPER} --campaign one.yaml --duration 1 --only 0"
    told = tell(campaign).out + tell(f"{campaign} --config own.yaml").out
    ours, theirs = [line for line in told.splitlines() if line.startswith("drawn: ")]
    assert "initial_error_angle" in ours
    assert "inertia_error" in ours
    assert theirs.split(", ")[0] == "drawn: actuator_strength 1"
    assert theirs.endswith("rate_noise 1e-06")


def test_each_run_of_a_campaign_has_noise_of_its_own_and_is_judged_by_its_laws_bounds(
    tell: Tell, tmp_path: Path
) -> None:
    """An environment that depends on time and on its seed alone was the same in all runs."""
    choose(tmp_path, INJECTOR, "environment: gusty")
    (tmp_path / "nothing.yaml").write_text("campaign: {}\n")
    campaign = f"campaign {PAPER} --config own.yaml --campaign nothing.yaml --duration 1 --json"
    campaign += " --controller margin"
    told = tell(f"{campaign} --runs 2 --workers 1 --out out", code=1).json["requirements"]
    names = [each["name"] for each in told]
    assert names.count("attitude error outside its envelope") == 1
    alone = tell(f"{campaign} --only 1", code=1).json["metrics"]
    first, second = (row["max_rate_deg_s"] for row in rows_of(tmp_path / "out"))
    assert first != second == alone["max_rate_deg_s"]
    bands = rows_of(tmp_path / "out", "error_over_time.parquet")
    assert max(each["low"] for each in bands if each["quantity"] == "normalised_error") > 1.0


def test_a_campaign_draws_one_of_four_numbers_and_a_quaternion_as_such(
    tell: Tell, tmp_path: Path
) -> None:
    """Every list of four was taken for a quaternion."""
    pushes, turn = f"{INJECTOR}.push.torques[2]", "reference_generator.turn.initial_attitude"
    given = {pushes: 0.01, turn: {"distribution": "cone", "angle": 0.1}}
    (tmp_path / "varied.yaml").write_text(json.dumps({"campaign": {"parameters": given}}))
    campaign = f"campaign {CONFIGS} --campaign varied.yaml --duration 1 --only 0 --json"
    drawn = tell(campaign).json["drawn"]
    assert drawn[pushes] == 0.01
    assert math.hypot(*(drawn[f"{turn}[{k}]"] for k in range(4))) == pytest.approx(1.0)


def test_a_law_that_reads_neither_attitude_nor_rate_flies(tell: Tell) -> None:
    given = f"{PAPER} --controller blind"
    assert tell(f"simulate {given} --duration 0.1 --json").json["controller"] == "blind"
    assert "initial attitude error x y z w: -0.22952, 0.25933" in tell(f"check {given}").out


def test_a_law_that_hears_its_estimator_later_is_checked_too(tell: Tell, tmp_path: Path) -> None:
    """As if told the truth there would be no estimator, and nothing that the law reads."""
    choose(tmp_path, "/**", "sensors: rounding, estimator: quiet, controller: listening")
    told = tell(f"check {PAPER} --config own.yaml")
    assert "initial attitude error x y z w: -0.22952, 0.25933" in told.out


def test_the_truth_is_on_record_whatever_sensors_from_outside_say_of_themselves(
    tell: Tell, tmp_path: Path
) -> None:
    """These round, and the estimator behind them takes the mean of two rates."""
    choose(tmp_path, "spacecraft_plant", "sensors: sure")
    command = f"simulate {CONFIGS} --config own.yaml --duration 1 --json"
    told = tell(command).json
    assert told["truth"] == "recorded"
    knowledge = next(each for each in told["errors"] if each["name"] == "knowledge")
    assert knowledge["max_deg"] > 0.0


def test_a_run_fails_where_the_step_of_a_part_raises(tell: Tell, tmp_path: Path) -> None:
    choose(tmp_path, "disturbance_injector", "environment: table")
    told = tell("simulate --duration 0.5 --config own.yaml", code=3)
    assert "diverged: angular velocity (nan, nan, nan)" in told.err
    assert "at 0.11 s; the step of component table raised ValueError: beyond my" in told.err


@pytest.mark.ros
@pytest.mark.long
def test_a_run_names_sensors_that_fail(tell: Tell, tmp_path: Path) -> None:
    """Not the estimator that refuses what they give, nor the plant that waits for it in vain."""
    choose(tmp_path, "spacecraft_plant", "sensors: failing")
    told = tell(f"run {CONFIGS} --config own.yaml --duration 1 --bag bag", code=3)
    assert "spacecraft_plant ended with exit code 3: at t = 0.110 s failing g" in told.err
    assert "the step of component failing raised ValueError: the cap is on" in told.err


def test_a_step_that_writes_beyond_its_column_fails(tell: Tell) -> None:
    """It would be the memory of others."""
    told = tell(f"simulate {PAPER} --controller beyond_column --duration 0.1", code=3)
    raised = "component beyond_column raised IndexError: index is out of bounds"
    assert raised in told.err
    told = tell(f"check {PAPER} --controller beyond_column", code=2)
    assert f"the first instant fails; the step of {raised}" in told.err


def test_a_loop_is_measured_by_the_period_of_its_actuator(tell: Tell, tmp_path: Path) -> None:
    """One that takes each fourth command is the ideal one of a craft with a fourth of the steps."""
    law = "controller: quaternion_feedback, quaternion_feedback.natural_frequency: 0.7"
    choose(tmp_path, "/**", f"{law}, quaternion_feedback.integral_time: 1e9, min_torque: 0.0")
    margins = []
    for rate, actuator in ((10.0, "held"), (2.5, "ideal")):
        choose(tmp_path, "spacecraft_plant", f"rate: {rate}, actuator: {actuator}", "two.yaml")
        told = tell(f"check {PAPER} --config own.yaml --config two.yaml --json").json["conditions"]
        margins += [each["value"] for each in told if each["name"] == "loop margin"]
    assert margins[0] == pytest.approx(margins[1], rel=1e-3)


def test_check_compares_the_envelopes_with_the_noise_that_parts_declare(
    tell: Tell, tmp_path: Path
) -> None:
    choose(tmp_path, "/**", "sensors: rounding, estimator: two_rates")
    conditions = tell(f"check {PAPER} --config own.yaml --json").json["conditions"]
    (floor,) = (
        each["limit"] for each in conditions if each["name"] == "attitude_envelope.terminal"
    )
    assert floor == pytest.approx(6.0 * 1e-6 / math.sqrt(12.0))  # of the rounding
