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

"""A campaign on a real Dask cluster of several processes gives what it gives at home."""

import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from campaign_helpers import compute_here, files_of, rows_of, small
from conftest import StartProcess
from craft_helpers import ROOT
from process_helpers import COMMAND, PAPER, PATIENCE, Process, until

from ppc_attitude.campaign import pools
from ppc_attitude.campaign.campaign import Finished, run_campaign
from ppc_attitude.campaign.rows import CampaignError
from ppc_attitude.science.errors import ConfigurationError

WORKERS = 2
RUNS = 60
pytestmark = pytest.mark.slow


class Cluster:
    """Scheduler and workers, each a process of its own on this machine."""

    def __init__(self, start_process: StartProcess, folder: Path, workers: int) -> None:
        self._start, self._folder = start_process, folder
        command = ["scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
        self.scheduler = self._run(*command, stderr=subprocess.PIPE)
        assert self.scheduler.stderr is not None
        said = next(line for line in self.scheduler.stderr if "Scheduler at:" in line)
        self.address = said.split()[-1]
        self.workers = [
            self._run("worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard")
            for _ in range(workers)
        ]
        from distributed import Client  # by the one worker that runs these tests

        self.client = Client(self.address, set_as_default=False)
        self.client.wait_for_workers(workers, timeout=PATIENCE)

    def _run(self, *arguments: str, stderr: int = subprocess.DEVNULL) -> "subprocess.Popen[str]":
        command = [sys.executable, "-m", f"distributed.cli.dask_{arguments[0]}", *arguments[1:]]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        return self._start(
            command, cwd=self._folder, env=environment, stdout=subprocess.DEVNULL, stderr=stderr
        )


@pytest.fixture
def cluster(
    start_process: StartProcess, tmp_path: Path, request: pytest.FixtureRequest
) -> Iterator[Cluster]:
    cluster = Cluster(start_process, tmp_path, getattr(request, "param", WORKERS))
    yield cluster
    cluster.client.close()


def test_a_killed_worker_loses_and_doubles_nothing(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    of = small(duration=10.0, rate=100.0)
    pids = cluster.client.run(os.getpid)
    killed: list[int] = []

    def kill_one(done: int) -> None:
        chunks = cluster.client.processing()
        busiest = max(chunks, key=lambda place: len(chunks[place]))
        if chunks[busiest] and not killed:
            (victim,) = (each for each in cluster.workers if each.pid == pids[busiest])
            victim.send_signal(signal.SIGKILL)
            killed.append(victim.wait())

    away = run_campaign(of, RUNS, tmp_path / "away", scheduler=cluster.address, progress=kill_one)
    compute_here(monkeypatch)
    run_campaign(of, RUNS, tmp_path / "home")
    assert killed == [-signal.SIGKILL]
    assert [row["index"] for row in rows_of(tmp_path / "away")] == list(range(RUNS))
    assert away.summary.broken == 0
    assert files_of(tmp_path / "away") == files_of(tmp_path / "home")


@pytest.mark.long
def test_a_lost_scheduler_is_told_and_what_was_done_is_kept(
    cluster: Cluster, tmp_path: Path
) -> None:
    def kill_scheduler(done: int) -> None:
        if done == 20:
            cluster.scheduler.send_signal(signal.SIGKILL)
            cluster.scheduler.wait()

    with pytest.raises(CampaignError, match=r"the scheduler tcp://127\.0\.0\.1:\d+ was lost"):
        run_campaign(
            small(duration=60.0, rate=100.0),
            1000,
            tmp_path / "away",
            scheduler=cluster.address,
            progress=kill_scheduler,
        )
    kept = [row["index"] for row in rows_of(tmp_path / "away")]
    assert kept[:20] == list(range(20))


def test_a_connection_that_is_cut_amid_an_answer_is_a_lost_scheduler(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It ended in a traceback, where the scheduler was lost at the wrong moment."""
    from distributed.comm import CommClosedError

    address = "tcp://127.0.0.1:8786"
    monkeypatch.setattr(pools, "connected", lambda _: Mock(nthreads=lambda: {address: 1}))
    pool = pools.ClusterPool(small(), address)
    with pytest.raises(CampaignError, match=f"the scheduler {address} was lost"):
        pool.lost(CommClosedError("reset by peer"))
    assert not pool.lost(CampaignError("a worker has other versions")), "this is told as it is"


@pytest.mark.long
@pytest.mark.parametrize("cluster", [1], indirect=True)
def test_a_search_says_that_its_scheduler_was_lost(
    cluster: Cluster, tmp_path: Path, start_process: StartProcess
) -> None:
    """It ended in a traceback, or waited for ever."""
    command = [*COMMAND, "falsify", "--config", str(PAPER), "--duration", "5", "--runs", "100000"]
    command += ["--scheduler", cluster.address]
    search = Process(start_process, tmp_path, "search", command, cwd=tmp_path)
    until(lambda: "settled" in search.err, "its first generation")
    cluster.scheduler.send_signal(signal.SIGKILL)
    cluster.scheduler.wait()
    assert search.ends() == 3
    told = search.err.splitlines()[-1]
    assert told == f"error: the scheduler {cluster.address} was lost; the same command continues"


def stopped(
    cluster: Cluster, folder: Path, progress: Callable[[int], None], stop: threading.Event
) -> Finished:
    """Run a campaign that would last for minutes, until it is told to stop."""
    return run_campaign(
        small(duration=60.0, rate=100.0),
        100_000,
        folder,
        scheduler=cluster.address,
        progress=progress,
        stopping=lambda: nullcontext(stop),
    )


@pytest.mark.long
@pytest.mark.parametrize("cluster", [1], indirect=True)
def test_a_cluster_that_has_lost_all_its_workers_is_told_once(
    cluster: Cluster,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Dask waits without a word for a worker that may never come."""
    monkeypatch.setattr(pools, "_LOOK", 0.1)
    stop, told = threading.Event(), list[str]()

    def tell(text: str, **_: Any) -> None:
        told.append(text)
        threading.Timer(1.0, stop.set).start()  # until when it may be told again

    def kill_all(done: int) -> None:
        if done == 20:
            assert not told
            cluster.workers[0].send_signal(signal.SIGKILL)

    monkeypatch.setattr(pools, "print", tell, raising=False)

    cut = stopped(cluster, tmp_path / "away", kill_all, stop)
    assert 20 <= cut.summary.runs < 1000
    assert told == [f"\nthe scheduler {cluster.address} has no worker: waiting for one"]


@pytest.mark.long
def test_a_stop_leaves_the_cluster_free(cluster: Cluster, tmp_path: Path) -> None:
    stop = threading.Event()

    def at_twenty(done: int) -> None:
        if done >= 20:
            stop.set()

    cut = stopped(cluster, tmp_path / "away", at_twenty, stop)
    assert 20 <= cut.summary.runs == len(rows_of(tmp_path / "away")) < 100_000
    again = run_campaign(small(), 20, tmp_path / "again", scheduler=cluster.address)
    assert again.summary.runs == 20


@pytest.mark.parametrize("address", ["foo://x", "host", "tcp://host", "tcp://host:port", "["])
def test_an_address_that_can_be_none_is_refused_at_once(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("distributed.Client", lambda *_, **__: pytest.fail("asked"))
    with pytest.raises(ConfigurationError, match=re.escape(f"scheduler = {address}; allowed: ")):
        pools.connected(address)


def test_an_address_without_scheduler_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pools, "_PATIENCE", 0.5)
    with pytest.raises(ConfigurationError, match=r"scheduler = tcp://127\.0\.0\.1:1: no Dask"):
        run_campaign(small(), 1, tmp_path / "c", scheduler="tcp://127.0.0.1:1")
    assert not (tmp_path / "c").exists()
