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

"""Small campaigns for the tests, and what is in their files."""

from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from ppc_attitude.campaign.campaign import Finished, run_campaign
from ppc_attitude.campaign.declaration import Campaign, campaign
from ppc_attitude.campaign.rows import Outcome, run_chunk
from ppc_attitude.contract.topics import INJECTOR, PLANT
from ppc_attitude.simulation.scenario import scenario

RUNS = 40
VARIES = {
    "initial_attitude": {"distribution": "cone", "angle": 0.3},
    "initial_rate": {"magnitude": {"distribution": "uniform", "low": 0.0, "high": 0.005}},
    "inertia_error": {"distribution": "uniform", "low": 0.0, "high": 0.2},
    "disturbance": {
        "time": {"distribution": "uniform", "low": 0.05, "high": 0.1},
        "duration": 0.1,
        "torque": {"distribution": "uniform", "low": 0.1, "high": 1.0},
    },
    "attitude_noise": {"distribution": "log_uniform", "low": 1e-7, "high": 1e-5},
}


def small(duration: float = 3.0, rate: float = 50.0) -> Campaign:
    """A campaign of short runs."""
    given = {PLANT: {"duration": duration, "rate": rate}, INJECTOR: {"environment": True}}
    return campaign(VARIES, scenario(given), 1)


def run_one(of: Campaign, index: int) -> Outcome:
    """One run of a campaign."""
    (outcome,) = run_chunk(of, index, index + 1)
    return outcome


def rows_of(folder: Path) -> list[dict[str, Any]]:
    """Rows of a finished campaign."""
    rows: list[dict[str, Any]] = pq.read_table(folder / "runs.parquet").to_pylist()
    return rows


def files_of(folder: Path) -> dict[str, bytes]:
    """Every file of a folder."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def finish(folder: Path) -> Finished:
    """A campaign of RUNS short runs, done in one process."""
    return run_campaign(small(), RUNS, folder, workers=1)
