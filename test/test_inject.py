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

"""A torque injected into a running stack: what acted is in the bag, and the bag alone tells it."""

import os
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import StartProcess
from process_helpers import PATIENCE

from ppc_attitude.analysis.metrics import analyse
from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line import errors
from ppc_attitude.command_line.main import main
from ppc_attitude.contract.topics import INJECTOR
from ppc_attitude.nodes import visiting

ROOT = Path(__file__).parent.parent
TORQUE = (0.3, -0.2, 0.1)  # [N·m]

pytestmark = pytest.mark.ros


def command(*words: str) -> list[str]:
    return [sys.executable, "-m", "ppc_attitude.command_line.main", *words]


@pytest.mark.parametrize("mode", ["--realtime", pytest.param("lock-step", marks=pytest.mark.long)])
def test_an_injected_torque_acts_for_its_duration_and_is_found_in_the_bag(
    mode: str, tmp_path: Path, start_process: StartProcess, ros_domain: int
) -> None:
    bag = tmp_path / "bag"
    configuration = ["--config", str(ROOT / "config/paper.yaml")]
    if mode == "lock-step":  # at the pace of the wall clock, so that there is time to inject
        pace = tmp_path / "pace.yaml"
        pace.write_text("spacecraft_plant:\n  ros__parameters:\n    real_time_factor: 1.0\n")
        configuration += ["--config", str(pace)]
    options = ["--realtime"] if mode == "--realtime" else []
    run = start_process(
        command("run", *configuration, "--duration", "10", "--bag", str(bag), *options),
        env={**os.environ, "ROS_DOMAIN_ID": str(ros_domain)},
    )
    assert run.stderr is not None
    shown = ""
    while "| 1." not in shown:  # the progress bar is past the first second: the stack is up
        more = run.stderr.read(1)
        assert more, shown
        shown += more
    torque = [str(value) for value in TORQUE]
    injection = start_process(command("inject", *torque, "--duration", "0.25", "--at", "5.0"))
    out, err = injection.communicate(timeout=PATIENCE)
    assert injection.returncode == 0, err
    found = re.search(r"acts from t = (\S+) s to (\S+) s", out)
    assert found, out
    start, end = map(float, found.groups())
    assert start >= 5.0  # later only where this process came too late to be answered in time
    assert end == pytest.approx(start + 0.25, abs=1e-6)
    _, err = run.communicate(timeout=PATIENCE)
    assert run.returncode in (0, 1), err

    record = read_run(bag)
    disturbances = analyse(record).metrics.disturbances
    assert len(disturbances) == 1
    assert disturbances[0].start_s == pytest.approx(start, abs=1e-6)
    assert disturbances[0].duration_s == pytest.approx(0.25, abs=1e-9)
    assert disturbances[0].torque == pytest.approx(TORQUE, abs=1e-4)
    assert np.abs(record["disturbance_torque"]).max() < 0.31
    assert main(["replay", str(bag)]) == 0


def test_a_refusal_is_told_and_makes_the_command_fail(
    start_process: StartProcess, capsys: pytest.CaptureFixture[str]
) -> None:
    start_process([sys.executable, "-m", f"ppc_attitude.nodes.{INJECTOR}"])
    assert main(["inject", "99", "0", "0"]) == errors.BAD_INPUT
    told = capsys.readouterr()
    assert not told.out
    allowed = "up to 10.0 N·m per axis (max_injected_torque)"
    assert told.err == f"error: torque = (99.0, 0.0, 0.0) N·m; allowed: {allowed}\n"


def test_nobody_to_inject_into_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(visiting, "_PATIENCE", 0.5)
    assert main(["inject", "0.1", "0.1", "0.1"]) == errors.BROKEN
    err = capsys.readouterr().err
    assert "nobody offers /disturbance_injector/inject" in err
