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

"""The measurements work and say what they promise; what they measure is nobody's test."""

import itertools
import json
from pathlib import Path

import numpy as np
import pytest

from bench import alternating, in_process, latency, start_up
from bench.__main__ import main
from bench.lockstep import ALL, bare_steps_per_s
from bench.table import number
from ppc_attitude.simulation.scenario import scenario


def test_pairs_alternate_and_give_medians() -> None:
    order: list[str] = []
    first, second = itertools.count(1), itertools.count(10)

    def ours() -> float:
        order.append("ours")
        return float(next(first))

    def other() -> float:
        order.append("other")
        return float(next(second))

    assert alternating(3, ours, other) == (2.0, 11.0)
    assert order == ["ours", "other"] * 3


def test_an_answer_that_is_late_or_absent_misses_its_deadline() -> None:
    trips = np.array([*np.full(97, 0.002), 0.005, 0.02, np.nan])
    found = latency.summary(trips, 100.0)
    assert found["missed"] == 2
    assert found["sent"] == 100
    assert found["p50_us"] == pytest.approx(2000.0)
    assert 5000.0 < found["p999_us"] < 20_000.0


def test_what_is_not_measured_again_keeps_its_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    figures = {"first_run_s": 11.0, "second_run_s": 3.5}
    monkeypatch.setattr(start_up, "measure", lambda quick: figures)
    output = tmp_path / "bench.json"
    output.write_text(
        '{"in_process": {"sim_s_per_s": 9.0, "basilisk_compiled": 3.0, '
        '"basilisk_numba": 4.5, "basilisk_python": 1.0}}'
    )
    main(["--only", "start_up", "--output", str(output)])
    kept = json.loads(output.read_text())
    assert kept["start_up"] == figures
    assert kept["in_process"]["sim_s_per_s"] == 9.0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("|")]
    shown = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]
    assert ["in process, simulated s/s", "9", "Basilisk, compiled: 3", "3", "10"] in shown
    assert ["start-up to the first step, second run", "3.5 s", "", "", "5 s"] in shown


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "–"), (0.8123, "0.812"), (15.149, "15.1"), (999.6, "1000"), (1.98e6, "1.98 M")],
)
def test_figures_have_three_digits(value: float | None, text: str) -> None:
    assert number(value) == text


@pytest.mark.long
def test_bare_step_steps() -> None:
    assert bare_steps_per_s(0.2) > 0.0
    assert bare_steps_per_s(0.2, ALL) > 0.0


@pytest.mark.ros
def test_an_echo_answers() -> None:
    trips = latency.echo_trips(100.0, 0.5)
    assert trips.size >= 50
    assert np.isfinite(trips).any()  # a machine may be too busy for some


def test_loop_is_measured() -> None:
    assert in_process.ours_s_per_s(scenario({}), 1.0, 1) > 0.0


@pytest.mark.long
def test_only_bag_reading(tmp_path: Path) -> None:
    output = tmp_path / "bench.json"
    main(["--only", "bag_reading", "--quick", "--output", str(output)])
    figures = json.loads(output.read_text(encoding="utf-8"))
    assert set(figures) == {"bag_reading", "machine"}
    found = figures["bag_reading"]
    for storage in (found, found["sqlite3"]):
        assert storage["ratio"] == pytest.approx(
            storage["messages_per_s"] / storage["rosbags_messages_per_s"]
        )
        assert storage["result_mb"] == pytest.approx(6001 * 45 * 8 / 1e6)
