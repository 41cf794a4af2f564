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

"""Where chunks of runs are computed: processes of this machine, or a Dask cluster.

Both give futures of `concurrent.futures`, and both say of an exception whether it means that the
process that computed was lost (killed, out of memory) rather than that the runs went wrong.
"""

import asyncio
import contextlib
import os
import sys
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing import Pipe
from queue import SimpleQueue
from typing import Any, TypeAlias

from ppc_attitude.campaign import worker
from ppc_attitude.campaign.declaration import Campaign
from ppc_attitude.campaign.rows import CampaignError, Outcome, run_chunk
from ppc_attitude.processes.child import Child
from ppc_attitude.science.errors import ConfigurationError, needed_by

_PATIENCE = 30.0  # [s] for a scheduler to answer, and for its first worker
_LOOK = 5.0  # [s] between looks at whether a cluster has workers


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def threads() -> Iterator[Executor]:
    """Threads of this process, one a core, whose compiled loops run side by side.

    At the end nobody waits for what they still do: a step of another package may never end.
    """
    executor = ThreadPoolExecutor(cores())
    try:
        yield executor
    finally:
        executor.shutdown(wait=False, cancel_futures=True)


class WorkerLostError(Exception):
    """The process that computed is gone."""


class _Worker:
    """One process and the only pipe to it, so that its end, even in mid-answer, is seen as such."""

    def __init__(self, campaign: Campaign) -> None:
        self._connection, other = Pipe()
        with other:
            pipe = other.fileno()
            self.child = Child(worker.__name__, str(pipe), inherited=[pipe], copy=True)
        self._campaign: Campaign | None = campaign  # until it has been told

    def ask(self, start: int, stop: int) -> list[Outcome]:
        """Have a chunk computed and wait for it."""
        try:
            if self._campaign is not None:
                self._connection.send(self._campaign)
                self._campaign = None
            self._connection.send((start, stop))
            answer = self._connection.recv()
        except (EOFError, OSError):
            raise WorkerLostError(f"exit code {self.child.process.wait()}") from None
        if isinstance(answer, Exception):
            raise answer
        outcomes: list[Outcome] = answer
        return outcomes


class LocalPool:
    """Processes of this machine, each with a thread here that waits for it.

    The standard library's pool shares one pipe among all processes: one that is killed while it
    answers blocks that pool for ever. Here it costs its own chunk.

    The kernels of the campaign should be warm: else each process compiles them.
    """

    def __init__(self, campaign: Campaign, workers: int) -> None:
        self.slots = workers
        self._campaign = campaign
        self._closed = False
        self._workers: list[_Worker | None] = [_Worker(campaign) for _ in range(workers)]
        self._idle: SimpleQueue[int] = SimpleQueue()
        for place in range(workers):
            self._idle.put(place)
        self._threads = ThreadPoolExecutor(workers)

    def submit(self, start: int, stop: int) -> "Future[list[Outcome]]":
        """Have the runs from start up to, not including, stop computed."""
        return self._threads.submit(self._compute, start, stop)

    def _compute(self, start: int, stop: int) -> list[Outcome]:
        place = self._idle.get()
        try:
            worker = self._workers[place] = self._workers[place] or _Worker(self._campaign)
            if self._closed:  # this worker began after the others had been killed
                worker.child.kill()
            return worker.ask(start, stop)
        except WorkerLostError:
            self._workers[place] = None
            raise
        finally:
            self._idle.put(place)

    def lost(self, error: BaseException) -> bool:
        """True if the error means that the process that computed is gone."""
        return isinstance(error, WorkerLostError)

    def check(self) -> None:
        """Do nothing: a process that is gone ends its chunk."""

    def close(self) -> None:
        """End everything, now."""
        self._closed = True
        self._threads.shutdown(wait=False, cancel_futures=True)
        for each in self._workers:
            if each is not None:
                each.child.kill()
        self._threads.shutdown()


class ClusterPool:
    """A Dask cluster, which has this package installed in the same version (`connected`)."""

    def __init__(self, campaign: Campaign, address: str) -> None:
        self._client = connected(address)
        import distributed

        self.slots = max(sum(self._client.nthreads().values()), 1)
        self._killed: type[BaseException] = distributed.KilledWorker
        self._cut_off = cut_off()
        self._campaign, self._address = campaign, address

    def submit(self, start: int, stop: int) -> "Future[list[Outcome]]":
        """Have the runs from start up to, not including, stop computed."""
        remote = self._client.submit(run_chunk, self._campaign, start, stop, pure=False)
        # Dask's own executor takes the result of a worker that is killed amid it for an error.
        return asyncio.run_coroutine_threadsafe(_answer(remote), self._client.loop.asyncio_loop)

    def lost(self, error: BaseException) -> bool:
        """True if the error means that the process that computed is gone."""
        if isinstance(error, self._cut_off):
            raise _scheduler_lost(self._address) from None
        return isinstance(error, self._killed)

    def check(self) -> None:
        """Raise CampaignError if the scheduler was lost."""
        see_that_it_is_connected(self._client, self._address)

    def close(self) -> None:
        """End everything, now."""
        _disconnect(self._client)


async def _answer(remote: Any) -> list[Outcome]:
    outcomes: list[Outcome] = await remote
    return outcomes


Pool: TypeAlias = LocalPool | ClusterPool
"""Something that computes chunks of runs, as many at once as it has slots."""


def connected(address: str) -> Any:
    """Client of a Dask cluster that has a worker, by its scheduler: ``tcp://host:8786``.

    Raises
    ------
    ConfigurationError
        Dask is not installed, no scheduler answers there, or it has no worker.
    """
    with needed_by("a Dask scheduler needs Dask", "campaign"):
        import distributed
        from distributed.comm.addressing import get_address_host_port
    try:  # Dask's client takes a minute to refuse a text that is no address
        get_address_host_port(address)
    except ValueError as error:
        allowed = "an address such as tcp://host:8786"
        raise ConfigurationError(f"scheduler = {address}; allowed: {allowed} ({error})") from None
    connect: Any = distributed.Client  # carries no types
    client = None
    try:
        client = connect(address, timeout=_PATIENCE, set_as_default=False)
        client.wait_for_workers(1, timeout=_PATIENCE)
    except (OSError, TimeoutError, ValueError) as error:
        if client is not None:
            _disconnect(client)
        raise ConfigurationError(
            f"scheduler = {address}: no Dask scheduler with a worker answers "
            f"within {_PATIENCE:g} s ({error})"
        ) from None
    client.loop.add_callback(_tell_if_deserted, client, address)
    return client


async def _tell_if_deserted(client: Any, address: str) -> None:
    """Tell once that no worker is left, for which Dask waits without a word."""
    with contextlib.suppress(OSError):  # a lost scheduler is told by others
        if client.status == "running" and not await client.nthreads():
            # The line on which a progress bar stands is left to it.
            print(f"\nthe scheduler {address} has no worker: waiting for one", file=sys.stderr)
            return
    if client.status not in ("closing", "closed"):
        client.loop.call_later(_LOOK, _tell_if_deserted, client, address)


def cut_off() -> tuple[type[BaseException], ...]:
    """Errors by which Dask tells that its scheduler was lost, before an answer or amid it."""
    from distributed.comm import CommClosedError

    return CancelledError, CommClosedError


def see_that_it_is_connected(client: Any, address: str) -> None:
    """Raise CampaignError if the client has given up: Dask may then forget what it was asked."""
    if client.status in ("closing", "closed"):
        raise _scheduler_lost(address)


def _scheduler_lost(address: str) -> CampaignError:
    return CampaignError(f"the scheduler {address} was lost")


def _disconnect(client: Any) -> None:
    with contextlib.suppress(OSError, TimeoutError):
        client.close()
