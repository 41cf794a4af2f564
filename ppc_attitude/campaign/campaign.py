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

"""A campaign from declaration to results: run, count, keep."""

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass
from pathlib import Path

from ppc_attitude.campaign.declaration import Campaign
from ppc_attitude.campaign.execution import outcomes
from ppc_attitude.campaign.pools import ClusterPool, LocalPool, Pool, cores
from ppc_attitude.campaign.quantile_bands import QuantileBands, time_bins
from ppc_attitude.campaign.results import Results
from ppc_attitude.campaign.summary import Summary
from ppc_attitude.science.errors import ConfigurationError


@dataclass(frozen=True)
class Finished:
    """A campaign that has been run.

    Attributes
    ----------
    folder : Path
        Where its files are.
    total : int
        How many runs were wanted; `summary.runs` were done.
    summary : Summary
        What it comes to.
    bands : QuantileBands
        Errors over time.
    """

    folder: Path
    total: int
    summary: Summary
    bands: QuantileBands


def run_campaign(
    campaign: Campaign,
    runs: int,
    folder: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int, int], None] = lambda _done, _wanted: None,
    stop: threading.Event | None = None,
    beginning: Callable[[], AbstractContextManager[object]] = nullcontext,
) -> Finished:
    """Run a campaign and keep its results in a folder.

    Parameters
    ----------
    campaign : Campaign
        What to run.
    runs : int
        How many runs, with indices from 0.
    folder : Path
        A folder that does not exist yet.
    workers : int, optional
        Processes on this machine; default one a core.
    scheduler : str, optional
        Address of a Dask scheduler to run on instead.
    progress : callable, optional
        Called with runs done and wanted after each.
    stop : threading.Event, optional
        Set it to end early, with what is there.
    beginning : callable, optional
        Gives the context in which kernels are compiled, or a scheduler is waited for.

    Returns
    -------
    Finished
        The same, and the same files, whoever computed and in whatever order.

    Raises
    ------
    ConfigurationError
        A number is wrong, the folder exists, no scheduler answers, or a package is missing.
    CampaignError
        The campaign could not go on; the runs done until then are in the folder.
    """
    for name, value in (("runs", runs), ("workers", workers)):
        if value is not None and value < 1:
            raise ConfigurationError(f"{name} = {value}; allowed: ≥ 1")
    _, ends = time_bins(campaign.stamps_ns)
    finished = Finished(
        folder, runs, Summary(campaign.required, campaign.variables), QuantileBands(ends)
    )
    pool: Pool
    with beginning():
        if scheduler:
            pool = ClusterPool(campaign, scheduler)
        else:
            pool = LocalPool(campaign, min(workers or cores(), runs))
    with closing(pool), closing(Results(folder, campaign, finished.bands)) as results:
        for outcome in outcomes(campaign, runs, pool, stop or threading.Event()):
            results.add(outcome.row)
            finished.summary.add(outcome.row)
            if outcome.levels is not None:
                finished.bands.add(outcome.levels)
            progress(finished.summary.runs, runs)
    return finished
