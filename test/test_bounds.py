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

"""A run that cannot be held is refused, and one that leaves all bounds is no result."""

import tracemalloc
from pathlib import Path

import pytest
from conftest import Ask
from craft_helpers import overlay, pulse
from process_helpers import PAPER

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.command_line import in_process
from ppc_attitude.command_line.in_process import check_memory
from ppc_attitude.contract.topics import INJECTOR, PLANT
from ppc_attitude.processes.exits import BAD_INPUT, BROKEN
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import load


def test_what_is_foreseen_holds_a_run_and_its_verdict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = load([PAPER], {PLANT: {"duration": 300.0}})
    Verdict(simulate(scenario, 1.0))  # what is loaded once is not of the run
    tracemalloc.start()
    Verdict(simulate(scenario, 300.0))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()

    free = tmp_path / "meminfo"
    monkeypatch.setattr(in_process, "_MACHINE", free)
    free.write_text(f"MemAvailable:  {peak // 1024} kB\n")
    with pytest.raises(ConfigurationError, match=r"3e\+04 instants need .* allowed here: ≤"):
        check_memory(scenario)
    free.write_text(f"MemAvailable:  {3 * peak // 1024} kB\n")
    check_memory(scenario)
    with pytest.raises(ConfigurationError):
        check_memory(scenario, at_once=10)


def test_a_container_may_have_less_than_the_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    limit = tmp_path / "memory.max"
    monkeypatch.setattr(in_process, "_CONTAINER", tmp_path)
    (tmp_path / "memory.current").write_text("900000000\n")
    (tmp_path / "memory.stat").write_text("anon 500000000\ninactive_file 400000000\n")
    for enough in ("max\n", "900000000\n"):
        limit.write_text(enough)
        check_memory(load([PAPER], {PLANT: {"duration": 100.0}}))
    limit.write_text("501000000\n")
    with pytest.raises(ConfigurationError, match=r"0\.000931 GiB are free"):
        check_memory(load([PAPER], {PLANT: {"duration": 100.0}}))


@pytest.mark.parametrize("command", ["campaign", "falsify"])
def test_runs_of_a_cluster_take_no_memory_of_this_machine(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ask: Ask
) -> None:
    monkeypatch.setattr(in_process, "_free", lambda: 1.0)
    for more, told in (([], "GiB are free"), (["--scheduler", "nobody"], "scheduler = nobody; ")):
        assert told in ask(command, f"--out={tmp_path / 'out'}", *more, code=BAD_INPUT).err


def test_a_simulation_that_diverges_says_so_and_judges_nothing(tmp_path: Path, ask: Ask) -> None:
    hit = {INJECTOR: pulse(1.0, 1000.0, 1e6, 1e6, 1e6)}
    wild, report = overlay(tmp_path / "wild.yaml", hit), tmp_path / "report.html"
    options = ["--config", PAPER, "--config", wild, "--duration", 60, "--report", report]
    out, err = ask("simulate", *options, code=BROKEN)
    assert out == ""
    assert err.startswith("error: diverged: angular velocity (")
    assert not report.exists()
