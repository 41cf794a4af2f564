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

"""`campaign --only INDEX --record`: one run of a campaign through the nodes."""

import json
from pathlib import Path

import pytest
import yaml
from bag_helpers import assert_flown
from campaign_helpers import VARIES
from conftest import StartProcess
from craft_helpers import configs
from process_helpers import COMMAND, PATIENCE

from ppc_attitude.bags.reader import read_run
from ppc_attitude.campaign.declaration import campaign
from ppc_attitude.campaign.rows import rerun
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.simulation.scenario import load

RUN = 7


@pytest.mark.long
@pytest.mark.ros
def test_a_run_through_the_nodes_is_the_run_in_process(
    tmp_path: Path, start_process: StartProcess
) -> None:
    """Six processes in lock-step, with sensors and filter."""
    varies, bag = tmp_path / "varies.yaml", tmp_path / "bag"
    declared = {name: each for name, each in VARIES.items() if name != "attitude_noise"}
    varies.write_text(yaml.safe_dump({"campaign": declared}), encoding="utf-8")
    files = configs("paper", "sensors_smallsat")
    command = [*COMMAND, "campaign"]
    command += [option for path in files for option in ("--config", str(path))]
    command += ["--campaign", str(varies), "--duration", "2"]
    command += ["--seed", "1", "--only", str(RUN), "--record", "--bag", str(bag), "--json"]
    process = start_process(command)
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, err  # two seconds are too short to settle: that fails nothing
    of = campaign(declared, load(files, {PLANT: {"duration": 2.0}}), 1)
    verdict = rerun(of, RUN)
    told = json.loads(out)
    assert told["requirements"] == verdict.to_json()["requirements"]
    assert told["bag"] == str(bag)
    assert_flown(read_run(bag), verdict.record)
