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

"""The fixtures keep what they promise: domains differ, no process outlives its test."""

import os
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import pytest
from conftest import StartProcess, _own_domain

from ppc_attitude.nodes.discovery import DOMAINS

# Prints the number of a child in a session of its own and ends before it; the child waits for ever.
PARENT = """
import subprocess, sys
wait = [sys.executable, "-c", "import signal; signal.pause()"]
print(subprocess.Popen(wait, start_new_session=True).pid, flush=True)
"""


def memory_of(pid: int) -> bytes:
    """Read the environment of a process: empty once it has ended, even if nobody has reaped it."""
    try:
        return Path(f"/proc/{pid}/environ").read_bytes()
    except OSError:
        return b""


@pytest.fixture
def survivor(request: pytest.FixtureRequest) -> Iterator[list[int]]:
    """Set up before `start_process`, hence judged after that has cleaned up."""
    pids: list[int] = []
    yield pids
    assert pids
    assert not any(memory_of(pid) for pid in pids)


def test_kills_the_whole_family(survivor: list[int], start_process: StartProcess) -> None:
    process = start_process([sys.executable, "-c", PARENT])
    assert process.stdout is not None
    survivor.append(int(process.stdout.readline()))
    assert process.wait() == 0
    assert memory_of(survivor[0])


def test_domains_in_use_at_once_all_differ() -> None:
    with ExitStack() as stack:
        domains = [stack.enter_context(_own_domain()) for _ in range(20)]
        assert len(set(domains)) == len(domains)
        assert set(domains) <= set(DOMAINS)


def test_a_domain_is_free_again_afterwards() -> None:
    def borrow(_: int) -> int:
        with _own_domain() as domain:
            return domain

    with ThreadPoolExecutor(4) as pool:
        assert len(list(pool.map(borrow, range(3 * len(DOMAINS))))) == 3 * len(DOMAINS)


def test_environment_of_a_ros_test(ros_domain: int, tmp_path: Path) -> None:
    assert os.environ["ROS_DOMAIN_ID"] == str(ros_domain)
    assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert Path(os.environ["ROS_LOG_DIR"]).is_relative_to(tmp_path)
    assert os.environ["ROS_PYTHON_CHECK_FIELDS"] == "1"
