"""Where chunks of runs are computed: processes of this machine, or a Dask cluster.

Both give futures of `concurrent.futures`, and both say of an exception whether it means that the
process that computed was lost (killed, out of memory) rather than that the runs went wrong.
"""

import contextlib
import multiprocessing
import os
import signal
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Protocol

from ppc_attitude.campaign.declaration import Campaign
from ppc_attitude.campaign.rows import CampaignError, Outcome, run_chunk
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.simulation.closed_loop import warm_up

_PATIENCE = 30.0  # [s] for a scheduler to answer, and for its first worker


class Pool(Protocol):
    """Something that computes chunks of runs."""

    slots: int
    """How many chunks are computed at once."""

    def submit(self, campaign: Campaign, start: int, stop: int) -> "Future[list[Outcome]]":
        """Have the runs from start up to, not including, stop computed."""

    def lost(self, error: BaseException) -> bool:
        """True if the error means that the process that computed is gone."""

    def close(self) -> None:
        """End everything, now."""


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _leave_interrupts_to_the_starter() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


class LocalPool:
    """Processes of this machine.

    Parameters
    ----------
    campaign : Campaign
        What they will run: its kernels are compiled here, once, so that they find them cached.
    workers : int
        How many.
    """

    def __init__(self, campaign: Campaign, workers: int) -> None:
        warm_up(campaign.scenario)
        self.slots = workers
        self._executor = self._new()

    def _new(self) -> ProcessPoolExecutor:
        # A forked child would inherit the locks of threads that it does not have.
        return ProcessPoolExecutor(
            self.slots,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_leave_interrupts_to_the_starter,
        )

    def submit(self, campaign: Campaign, start: int, stop: int) -> "Future[list[Outcome]]":
        """Have the runs from start up to, not including, stop computed."""
        try:
            return self._executor.submit(run_chunk, campaign, start, stop)
        except BrokenProcessPool:  # a process of it was killed: all of it is gone
            self._executor.shutdown(wait=False)
            self._executor = self._new()
            return self._executor.submit(run_chunk, campaign, start, stop)

    def lost(self, error: BaseException) -> bool:
        """True if the error means that the process that computed is gone."""
        return isinstance(error, BrokenProcessPool)

    def close(self) -> None:
        """End everything, now."""
        processes = list((self._executor._processes or {}).values())
        self._executor.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()
        for process in processes:
            process.join()


class ClusterPool:
    """A Dask cluster, which has this package installed in the same version.

    Parameters
    ----------
    address : str
        Of the scheduler, such as ``tcp://host:8786``.

    Raises
    ------
    ConfigurationError
        Dask is not installed, no scheduler answers there, or it has no worker.
    """

    def __init__(self, address: str) -> None:
        try:
            import distributed
        except ImportError:
            raise ConfigurationError(
                "a Dask scheduler needs Dask: pip install 'ppc_attitude[campaign]'"
            ) from None
        self._killed: type[BaseException] = distributed.KilledWorker
        self._client: Any = None
        connect: Any = distributed.Client  # carries no types
        try:
            self._client = connect(address, timeout=_PATIENCE, set_as_default=False)
            self._client.wait_for_workers(1, timeout=_PATIENCE)
            self.slots = max(sum(self._client.nthreads().values()), 1)
        except (OSError, TimeoutError, ValueError) as error:
            self.close()
            raise ConfigurationError(
                f"scheduler = {address}: no Dask scheduler with a worker answers "
                f"within {_PATIENCE:g} s ({error})"
            ) from None
        self._address = address
        self._executor = self._client.get_executor(pure=False)

    def submit(self, campaign: Campaign, start: int, stop: int) -> "Future[list[Outcome]]":
        """Have the runs from start up to, not including, stop computed."""
        future: Future[list[Outcome]] = self._executor.submit(run_chunk, campaign, start, stop)
        return future

    def lost(self, error: BaseException) -> bool:
        """True if the error means that the process that computed is gone."""
        if isinstance(error, CancelledError):
            raise CampaignError(f"the scheduler {self._address} was lost") from None
        return isinstance(error, self._killed)

    def close(self) -> None:
        """End everything, now."""
        if self._client is not None:
            with contextlib.suppress(OSError, TimeoutError):
                self._client.close()
