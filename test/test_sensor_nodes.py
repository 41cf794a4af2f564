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

"""Six processes in lock-step with sensors and filter give the bits of the loop in process."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from estimation_helpers import ROOT
from process_helpers import PATIENCE

from ppc_attitude.bags.reader import read_run
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import load

pytestmark = pytest.mark.ros


@pytest.mark.parametrize(
    ("suite", "rate", "initial_fix", "duration"),
    [
        ("smallsat", 100.0, True, 2.0),
        pytest.param("cubesat", 50.0, False, 4.0, marks=pytest.mark.long),
        pytest.param("flagship", 1000.0, True, 1.0, marks=pytest.mark.long),
    ],
)
def test_nodes_and_loop_agree_to_the_last_bit(
    suite: str,
    rate: float,
    initial_fix: bool,
    duration: float,
    tmp_path: Path,
    ros_domain: int,
) -> None:
    overlay = tmp_path / "overlay.yaml"
    given = {"rate": rate, "initial_fix": initial_fix}
    overlay.write_text(yaml.safe_dump({"/**": {"ros__parameters": given}}))
    files = [ROOT / "config" / f"{name}.yaml" for name in ("paper", f"sensors_{suite}")]
    options = [option for path in (*files, overlay) for option in ("--config", str(path))]
    bag = tmp_path / "bag"
    options += ["--duration", f"{duration:g}", "--bag", str(bag)]
    subprocess.run(
        [sys.executable, "-m", "ppc_attitude.command_line.main", "run", *options],
        capture_output=True,
        timeout=2.0 * PATIENCE,
        check=False,  # so short a run meets no deadline
    )
    recorded = read_run(bag)
    expected = simulate(load([*files, overlay]), duration)
    assert recorded.columns.keys() == expected.columns.keys()
    assert not recorded.missing
    assert not recorded.warnings
    for name, column in expected.columns.items():
        assert np.array_equal(recorded[name], column, equal_nan=True), name
    unknown = ~expected["attitude"].any(axis=1)
    assert unknown.sum() == (0 if initial_fix else round(0.2 * rate))
