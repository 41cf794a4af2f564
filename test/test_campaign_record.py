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

"""`campaign --only INDEX --record`: one run of a campaign through the five nodes."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from campaign_helpers import VARIES, small
from conftest import StartProcess
from process_helpers import PATIENCE

from ppc_attitude.bags.reader import read_run
from ppc_attitude.campaign.rows import rerun
from ppc_attitude.command_line.main import main

RUN = 7


@pytest.mark.ros
def test_a_run_through_the_nodes_is_the_run_in_process(
    tmp_path: Path, start_process: StartProcess
) -> None:
    varies, config, bag = tmp_path / "varies.yaml", tmp_path / "config.yaml", tmp_path / "bag"
    varies.write_text(yaml.safe_dump({"campaign": VARIES}), encoding="utf-8")
    config.write_text("/**/spacecraft_plant:\n  ros__parameters:\n    rate: 50.0\n")
    command = [sys.executable, "-m", "ppc_attitude.command_line.main", "campaign"]
    command += ["--config", str(config), "--campaign", str(varies), "--duration", "3"]
    command += ["--seed", "1", "--only", str(RUN), "--record", "--bag", str(bag), "--json"]
    process = start_process(command)
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, err  # three seconds are too short to settle: that fails nothing
    expected, verdict = rerun(small(3.0, seed=1, rate=50.0), RUN)
    told = json.loads(out)
    assert told["requirements"] == verdict.to_json()["requirements"]
    assert told["bag"] == str(bag)
    recorded = read_run(bag)
    assert recorded.missing_messages == 0
    assert np.array_equal(recorded.stamps_ns, expected.stamps_ns)
    assert recorded.columns.keys() == expected.columns.keys()
    for name, samples in expected.columns.items():
        assert np.array_equal(recorded[name], samples), name


@pytest.mark.parametrize("option", [["--record"], ["--bag", "b"]])
def test_a_whole_campaign_is_not_recorded(
    option: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["campaign", *option]) == 2
    assert "--only INDEX" in capsys.readouterr().err


def test_the_shipped_campaign_is_the_default(capsys: pytest.CaptureFixture[str]) -> None:
    main(["campaign", "--only", "3", "--json"])
    default = capsys.readouterr().out
    shipped = Path(__file__).parents[1] / "config" / "campaign.yaml"
    main(["campaign", "--campaign", str(shipped), "--only", "3", "--json"])
    assert default == capsys.readouterr().out
