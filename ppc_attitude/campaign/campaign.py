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
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass
from pathlib import Path

from ppc_attitude.campaign.declaration import Campaign, draw
from ppc_attitude.campaign.pools import ClusterPool, LocalPool, Pool, cores
from ppc_attitude.campaign.quantile_bands import QuantileBands, time_bins
from ppc_attitude.campaign.results import Results
from ppc_attitude.campaign.rows import Outcome, broken
from ppc_attitude.campaign.summary import Summary

LARGEST_CHUNK = 16
"""Runs that a worker computes at a time: seconds, so that little is lost with a worker."""
_AHEAD = 4  # chunks of each slot that are submitted beyond the oldest unfinished one
_AGAIN = 2  # for a run in whose company a worker was lost: the first may have been bad luck
_GLANCE = 0.1  # [s] between looks at the wish to stop


@dataclass(frozen=True)
class Finished:
    """A campaign that has been run."""

    folder: Path  # where its files are
    total: int  # how many runs were wanted; `summary.runs` were done
    summary: Summary
    bands: QuantileBands  # errors over time


def run_campaign(
    campaign: Campaign,
    runs: int,
    folder: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int], None] = lambda _done: None,
    stopping: Callable[[], AbstractContextManager[threading.Event]] = lambda: nullcontext(
        threading.Event()
    ),
) -> Finished:
    """Run a campaign and keep its results in a folder.

    Parameters
    ----------
    campaign : Campaign
        What to run.
    runs : int
        How many runs, with indices from 0; at least one.
    folder : Path
        A folder that does not exist yet.
    workers : int, optional
        Processes on this machine, at least one; default one a core.
    scheduler : str, optional
        Address of a Dask scheduler to run on instead.
    progress : callable, optional
        Called with the number of runs done after each.
    stopping : callable, optional
        Gives a context manager, entered once workers are there, in which runs are computed. It
        yields an event; if that is set, the campaign ends early with the runs that are done.

    Returns
    -------
    Finished
        The results, which like the files do not depend on who computed in which order.

    Raises
    ------
    ConfigurationError
        The folder exists, no scheduler answers, or a package is missing.
    CampaignError
        The campaign could not go on; the runs done until then are in the folder.
    """
    _, ends = time_bins(campaign.stamps_ns)
    finished = Finished(
        folder, runs, Summary(campaign.required, campaign.variables), QuantileBands(ends)
    )
    pool: Pool
    if scheduler:
        pool = ClusterPool(campaign, scheduler)
    else:
        pool = LocalPool(campaign, min(workers or cores(), runs))
    with (
        stopping() as stop,
        closing(pool),
        closing(Results(folder, campaign, finished.bands)) as results,
    ):
        for outcome in outcomes(campaign, runs, pool, stop):
            results.add(outcome.row)
            finished.summary.add(outcome.row)
            if outcome.levels is not None:
                finished.bands.add(outcome.levels)
            progress(finished.summary.runs)
    return finished


def outcomes(campaign: Campaign, runs: int, pool: Pool, stop: threading.Event) -> Iterator[Outcome]:
    """Compute the runs 0 … runs − 1 and yield them in this order.

    A chunk whose worker was lost is computed again run by run; a run with which workers keep
    being lost becomes an outcome that says so. Memory does not grow with the number of runs.
    Once a stop is asked for, what is finished by then is yielded and the rest left out.

    Raises
    ------
    CampaignError
        The campaign cannot go on.
    """
    size = max(1, min(LARGEST_CHUNK, runs // (_AHEAD * pool.slots)))
    pending: deque[tuple[range, Future[list[Outcome]]]] = deque()
    following = 0
    while not stop.is_set():
        while following < runs and len(pending) < _AHEAD * pool.slots:
            end = min(following + size, runs)
            pending.append((range(following, end), pool.submit(following, end)))
            following = end
        if not pending:
            return
        if _finished(pending[0][1], pool):
            yield from _result(campaign, *pending[0], pool)
            pending.popleft()
    for _, future in pending:
        if future.done() and not future.cancelled() and not future.exception():
            yield from future.result()


def _finished(future: "Future[list[Outcome]]", pool: Pool) -> bool:
    """Wait for a moment; False if a result is still to come."""
    if wait([future], timeout=_GLANCE).done:
        return True
    pool.check()
    return False


def _result(
    campaign: Campaign,
    indices: range,
    future: "Future[list[Outcome]]",
    pool: Pool,
    again: int = _AGAIN,
) -> list[Outcome]:
    """Outcomes of a chunk; if its worker is lost, of each run by itself, which tells with which."""
    try:
        while not _finished(future, pool):
            pass
        return future.result()
    except BaseException as error:
        if not pool.lost(error):
            raise
        why = f"every worker that ran it was lost: {error}"
    if not again:
        return [broken(campaign, index, why, draw(campaign, index)) for index in indices]
    alone = (range(index, index + 1) for index in indices)
    submitted = ((each, pool.submit(each.start, each.stop)) for each in alone)
    return [run for each in submitted for run in _result(campaign, *each, pool, again - 1)]
