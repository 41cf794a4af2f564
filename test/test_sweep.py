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

import math
import warnings
from pathlib import Path

import pytest
from conftest import Ask
from craft_helpers import configs, overlay
from process_helpers import PAPER

from ppc_attitude.contract.topics import CONTROLLER, PLANT

SWEEP = ("sweep", "--config", PAPER)


def test_hits_scale_with_the_actuator_and_with_the_required_settling_time(
    tmp_path: Path, ask: Ask
) -> None:
    weak, asked = {"max_torque": 0.02}, tmp_path / "asked.yaml"
    craft = overlay(tmp_path / "craft.yaml", {PLANT: weak, CONTROLLER: weak})
    asked.write_text("settling_deadline: 3.0\nterminal_window: 1.0\nsettled: 90 deg\n")
    told = ask(*SWEEP, "--config", craft, "--requirements", asked, "--json").json
    assert (told["torque"], told["at_s"]) == (0.32, 4.0)
    # In whole instants; those that fall on the same number of instants are one.
    assert [hit["duration_s"] for hit in told["hits"]] == [0.01, 0.02, 0.05]
    # It is recovered by the own requirement: 90° is never reached.
    assert {hit["recovery_time_s"] for hit in told["hits"]} == {0.0}


def test_a_hit_is_told_with_the_duration_that_is_flown(ask: Ask) -> None:
    flown = ["--at", 1, "--duration", 12, "--pulse-durations", 0.012, 0.003]
    assert [hit["duration_s"] for hit in ask(*SWEEP, *flown, "--json").json["hits"]] == [0.01, 0.02]


def test_hits_scale_with_the_selected_actuator(tmp_path: Path, ask: Ask) -> None:
    asked = tmp_path / "asked.yaml"
    asked.write_text("settling_deadline: 1.0\nterminal_window: 1.0\nsettled: 90 deg\n")
    strong = overlay(tmp_path / "strong.yaml", {PLANT: {"wheels.max_torque": [0.3]}})
    files = [f"--config={file}" for file in (*configs("wheels"), strong)]
    short = ["--requirements", asked, "--pulse-durations", 0.01, "--json"]
    told = ask(*SWEEP, *files, *short).json
    assert told["torque"] == pytest.approx(16.0 * 0.3 * 2.0 / math.sqrt(3.0), rel=1e-5)


def test_the_table_says_what_hits_and_gives_the_verdict_of_the_requirements(
    tmp_path: Path, ask: Ask
) -> None:
    asked = tmp_path / "asked.yaml"
    asked.write_text("settled: 90 deg\n")
    early = [*SWEEP, "--at", 1, "--duration", 11, "--pulse-durations", 0.1]
    lines = ask(*early, "--requirements", asked).out.splitlines()
    assert lines[0].startswith("0.8 N·m on every axis from 1 s on")
    assert lines[-1].split()[-1] == "met"
    lines = ask(*early).out.splitlines()
    assert "The craft has not settled when it is hit, so that the times include settling." in lines
    assert lines[-1].endswith("NOT MET")
    asked.write_text("settled: 40 deg\nrecovery: 0.5\n")
    late = ask(*early, "--requirements", asked).out.splitlines()[-1]
    assert (late.split()[1], late[-7:]) == ("0.88", "NOT MET")
    assert max(map(len, lines)) <= 80


def test_a_figure_of_hits_that_all_recover_has_its_layout(tmp_path: Path, ask: Ask) -> None:
    """Matplotlib gave up, with a warning, over the line of those that did not."""
    figure = tmp_path / "hits.png"
    brief = ["--at", 1, "--duration", 12, "--pulse-durations", 0.01]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ask(*SWEEP, *brief, "--figure", figure)
    link = tmp_path / "link.png"
    link.symlink_to(figure)
    assert "is no plain file" in ask(*SWEEP, *brief, "--figure", link, code=2).err


def test_a_run_that_ends_while_its_error_may_still_grow_is_not_judged(ask: Ask) -> None:
    """It had recovered after 0 s, 0.1 s after a hit that has moved nothing yet."""
    told = ask(*SWEEP, "--at", 80, "--pulse-durations", 0.1, "--duration", 80.2).out
    assert "The runs end 0.2 s after the hit begins, before the 10 s to recover" in told
    assert told.splitlines()[-1].endswith("not judged")


def test_a_hit_that_no_craft_survives_is_told(ask: Ask) -> None:
    """The table told a hundredth of a second outside, as the rest was no number."""
    hit = ["--torque", 1e6, "--pulse-durations", 0.1, "--at", 1, "--duration", 12]
    assert "error: diverged: angular velocity" in ask(*SWEEP, *hit, code=3).err


def test_a_hit_too_weak_to_be_told_from_an_environment_is_recovered_all_the_same(
    ask: Ask,
) -> None:
    weak = ["--torque", 9e-4, "--pulse-durations", 0.1, "--duration", 100]
    (hit,) = ask(*SWEEP, *weak, "--json").json["hits"]
    assert hit["recovery_time_s"] == 0.0
