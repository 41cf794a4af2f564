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

from concurrent.futures import Future
from pathlib import Path
from typing import Any

import pytest

from ppc_attitude.campaign.campaign import Finished, run_campaign
from ppc_attitude.campaign.declaration import Campaign, campaign
from ppc_attitude.campaign.pools import WorkerLostError
from ppc_attitude.campaign.rows import Outcome, run_chunk
from ppc_attitude.contract.topics import INJECTOR, PLANT
from ppc_attitude.simulation.scenario import scenario

RUNS = 24
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
    given = {PLANT: {"duration": duration, "rate": rate}, INJECTOR: {"environment": True}}
    return campaign(VARIES, scenario(given), 1)


class PoolHere:
    """Computes at once, in this process."""

    slots = 1

    def __init__(self, of: Campaign) -> None:
        self.of = of

    def submit(self, start: int, stop: int) -> "Future[list[Outcome]]":
        future: Future[list[Outcome]] = Future()
        future.set_result(run_chunk(self.of, start, stop))
        return future

    def lost(self, error: BaseException) -> bool:
        return isinstance(error, WorkerLostError)

    def check(self) -> None: ...

    def close(self) -> None: ...


def compute_here(patch: pytest.MonkeyPatch) -> None:
    """Let no worker compute a campaign: each takes two seconds to begin."""
    patch.setattr("ppc_attitude.campaign.campaign.LocalPool", lambda of, workers: PoolHere(of))


def run_one(of: Campaign, index: int) -> Outcome:
    (outcome,) = run_chunk(of, index, index + 1)
    return outcome


def rows_of(folder: Path, file: str = "runs.parquet") -> list[dict[str, Any]]:
    import pyarrow.parquet as pq  # who only runs campaigns need not have it

    rows: list[dict[str, Any]] = pq.read_table(folder / file).to_pylist()
    return rows


def files_of(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def finish(folder: Path) -> Finished:
    """A campaign of RUNS short runs, done in this process."""
    with pytest.MonkeyPatch.context() as patch:
        compute_here(patch)
        return run_campaign(small(), RUNS, folder)
