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

"""The command `sweep`: its hits are in proportion to the craft and to what is asked of it."""

import json
import math
from pathlib import Path

import pytest
from craft_helpers import configs

from ppc_attitude.command_line.main import main

(PAPER,) = configs("paper")


def test_hits_scale_with_the_actuator_and_with_the_required_settling_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    craft, asked = tmp_path / "craft.yaml", tmp_path / "asked.yaml"
    craft.write_text(
        "/**/spacecraft_plant: {ros__parameters: {max_torque: 0.02}}\n"
        "/**/ppc_controller: {ros__parameters: {max_torque: 0.02}}\n"
    )
    asked.write_text("settling_deadline: 3.0\nterminal_window: 1.0\nsettled: 90 deg\n")
    command = ["sweep", "--config", str(PAPER), "--config", str(craft)]
    assert main([*command, "--requirements", str(asked), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["torque"], told["at_s"]) == (0.32, 4.0)
    # In whole instants; those that fall on the same number of instants are one.
    assert [hit["duration_s"] for hit in told["hits"]] == [0.01, 0.02, 0.05]
    # It is recovered by the own requirement: 90° is never reached.
    assert {hit["recovery_time_s"] for hit in told["hits"]} == {0.0}


def test_a_hit_is_told_with_the_duration_that_is_flown(
    capsys: pytest.CaptureFixture[str],
) -> None:
    command = ["sweep", "--config", str(PAPER), "--at", "1", "--duration", "12", "--json"]
    assert main([*command, "--pulse-durations", "0.003", "0.012"]) == 0
    told = json.loads(capsys.readouterr().out)["hits"]
    assert [hit["duration_s"] for hit in told] == [0.01, 0.02]


def test_hits_scale_with_the_selected_actuator(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    strong, asked = tmp_path / "strong.yaml", tmp_path / "asked.yaml"
    strong.write_text("/**/spacecraft_plant: {ros__parameters: {wheels.max_torque: [0.3]}}\n")
    asked.write_text("settling_deadline: 1.0\nterminal_window: 1.0\nsettled: 90 deg\n")
    files = [*configs("paper", "wheels"), strong]
    command = ["sweep", *(word for file in files for word in ("--config", str(file))), "--json"]
    assert main([*command, "--requirements", str(asked), "--pulse-durations", "0.01"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["torque"] == pytest.approx(16.0 * 0.3 * 2.0 / math.sqrt(3.0), rel=1e-5)


def test_the_table_says_what_hits_and_gives_the_verdict_of_the_requirements(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = tmp_path / "asked.yaml"
    asked.write_text("settled: 90 deg\n")
    command = ["sweep", "--config", str(PAPER), "--at", "1", "--duration", "11"]
    command += ["--pulse-durations", "0.1"]
    assert main([*command, "--requirements", str(asked)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("0.8 N·m on every axis from 1 s on")
    assert lines[-1].split()[-1] == "met"
    assert main(command) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "The craft has not settled when it is hit, so that its times include settling." in lines
    assert lines[-1].endswith("NOT MET")
    assert max(map(len, lines)) <= 80


def test_a_run_that_ends_while_its_error_may_still_grow_is_not_judged(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """It had recovered after 0 s, 0.1 s after a hit that has moved nothing yet."""
    command = ["sweep", "--config", str(PAPER), "--at", "80", "--pulse-durations", "0.1"]
    assert main([*command, "--duration", "80.2"]) == 0
    told = capsys.readouterr().out
    assert "The runs end 0.2 s after the hit begins, before the 10 s to recover" in told
    assert told.splitlines()[-1].endswith("not judged")


def test_a_hit_that_no_craft_survives_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    """The table told a hundredth of a second outside, as the rest was no number."""
    command = ["sweep", "--config", str(PAPER), "--torque", "1e6", "--pulse-durations", "0.1"]
    assert main([*command, "--at", "1", "--duration", "12"]) == 3
    assert "error: diverged: angular velocity" in capsys.readouterr().err


def test_a_hit_too_weak_to_be_told_from_an_environment_is_recovered_all_the_same(
    capsys: pytest.CaptureFixture[str],
) -> None:
    command = ["sweep", "--config", str(PAPER), "--torque", "0.0009", "--pulse-durations", "0.1"]
    assert main([*command, "--duration", "100", "--json"]) == 0
    (hit,) = json.loads(capsys.readouterr().out)["hits"]
    assert hit["recovery_time_s"] == 0.0
