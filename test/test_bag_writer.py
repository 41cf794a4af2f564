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

"""Safety and refusals of the bag writer."""

import signal
import subprocess
import sys
from functools import partial
from pathlib import Path
from random import Random

import bag_child
import numpy as np
import pytest
from bag_helpers import assert_same, messages, record_all
from conftest import StartProcess
from process_helpers import room_for, until
from synthetic import normal_run

from ppc_attitude.bags.custom_data import UNFINISHED
from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.folder import Bag
from ppc_attitude.bags.reader import read_run
from ppc_attitude.bags.recover import recover
from ppc_attitude.bags.writer import BagWriter

SECOND = 1_000_000_000
CHILD = (sys.executable, str(Path(bag_child.__file__)))


def test_refusals_name_what_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r"storage is 'tape', allowed are mcap, sqlite3"):
        BagWriter(tmp_path / "bag", storage="tape")
    (tmp_path / "taken").mkdir()
    with pytest.raises(BagError, match=r"taken exists already"):
        BagWriter(tmp_path / "taken")
    assert list((tmp_path / "taken").iterdir()) == []
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match=r"cannot be made: Not a directory"):
        BagWriter(tmp_path / "file" / "bag")
    writer = BagWriter(tmp_path / "bag")
    writer.add_topic("/a", "std_msgs/msg/String")
    with pytest.raises(BagError, match=r"has topic /a already"):
        writer.add_topic("/a", "std_msgs/msg/String")
    with pytest.raises(
        BagError, match=r"'my_msgs/msg/Thing', the type of /b, is no type of ROS 2 Jazzy"
    ):
        writer.add_topic("/b", "my_msgs/msg/Thing")
    with pytest.raises(BagError, match=r"topic /c was not announced"):
        writer.write("/c", 0, b"")
    with pytest.raises(BagError, match=r"receive time of /a is -1 ns"):
        writer.write("/a", -1, b"")
    writer.close()
    writer.close()
    with pytest.raises(BagError, match=r"is closed"):
        writer.write("/a", 0, b"")


def test_an_exception_in_the_recorder_keeps_the_bag(tmp_path: Path, storage: str) -> None:
    run = normal_run(duration=0.2)
    with pytest.raises(ZeroDivisionError), BagWriter(tmp_path / "bag", storage=storage) as writer:
        record_all(writer, messages(run))
        raise ZeroDivisionError
    assert_same(read_run(tmp_path / "bag"), run)


def report(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    line = process.stdout.readline()
    assert line, "the recorder ended"
    return line


def assert_child_wrote(bag: Path, at_least: int) -> int:
    """The bag holds the first steps of the child, unchanged; returns how many."""
    run = read_run(bag)
    steps = np.arange(len(run.stamps_ns))
    np.testing.assert_array_equal(run.stamps_ns, steps * bag_child.STEP_NS)
    for topic in bag_child.TOPICS:
        expected = [bag_child.values(step, topic) for step in steps]
        np.testing.assert_array_equal(run[topic.column], expected)
    assert len(steps) >= at_least
    assert run.controller == "child"
    assert run.missing == {}
    return len(steps)


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2))]
)
def test_after_sigkill_all_but_the_last_second_is_there(
    tmp_path: Path, storage: str, seed: int, start_process: StartProcess
) -> None:
    bag = tmp_path / "bag"
    process = start_process([*CHILD, "endless", str(bag), storage])
    _, began = map(int, report(process).split())
    lifetime = int(Random(seed).uniform(1.1, 1.6) * SECOND)
    reports = []
    while not reports or reports[-1][1] < began + lifetime:
        step, time = map(int, report(process).split())
        reports.append((step, time))
    process.send_signal(signal.SIGKILL)
    process.wait()
    safe = max((step for step, time in reports if time < reports[-1][1] - SECOND), default=0)
    count = assert_child_wrote(bag, safe)
    (warning,) = read_run(bag).warnings
    assert warning.startswith("recording was cut: it has no metadata.yaml")

    assert recover(bag).counts.total() >= count * len(bag_child.TOPICS)
    assert_child_wrote(bag, count)
    (warning,) = read_run(bag).warnings
    assert warning.startswith("recording was cut: it has no metadata.yaml")
    assert "(since recovered)" in warning


def test_messages_become_safe_when_nothing_follows_them(
    tmp_path: Path, storage: str, start_process: StartProcess
) -> None:
    bag = tmp_path / "bag"
    process = start_process([*CHILD, "idle", str(bag), storage])
    assert report(process) == "idle\n"

    def are_there() -> bool:
        opened = Bag(bag)
        for _ in opened.blocks():
            pass
        return opened.counts.total() == bag_child.IDLE_STEPS * len(bag_child.TOPICS)

    until(are_there, "the last messages")
    with pytest.raises(BagError, match=r"is still being recorded"):
        recover(bag)
    (warning,) = read_run(bag).warnings
    assert warning.startswith("recording goes on: it has no metadata.yaml")
    process.kill()
    process.wait()
    (warning,) = read_run(bag).warnings
    assert warning.startswith("recording was cut: it has no metadata.yaml")
    assert assert_child_wrote(bag, bag_child.IDLE_STEPS) == bag_child.IDLE_STEPS


@pytest.mark.parametrize("gone", ["folder", "file", "mark"])
def test_a_folder_or_a_file_that_goes_ends_the_bag_at_once(
    gone: str, tmp_path: Path, storage: str
) -> None:
    bag = BagWriter(tmp_path / "bag", storage=storage)
    bag.add_topic("/a", "std_msgs/msg/String")
    bag.write("/a", 0, b"")
    file = {"mcap": "bag.mcap", "sqlite3": "bag.db3"}[storage]
    (bag.path / {"folder": "", "file": file, "mark": UNFINISHED}[gone]).rename(tmp_path / "other")
    for doing in (bag.flush, partial(bag.__exit__, None)):
        with pytest.raises(BagError, match="any further: its folder or a file of it was moved"):
            doing()


def test_a_bag_that_cannot_be_made_leaves_nothing_in_the_way(tmp_path: Path, storage: str) -> None:
    with room_for(10), pytest.raises(BagError, match="bag cannot be made: "):
        BagWriter(tmp_path / "bag", storage=storage)
    assert not list(tmp_path.iterdir())


def test_a_full_disk_is_named_and_leaves_a_readable_bag(
    tmp_path: Path, storage: str, start_process: StartProcess
) -> None:
    bag = tmp_path / "bag"
    process = start_process([*CHILD, "full", str(bag), storage])
    assert process.stdout is not None
    lines = process.stdout.read().splitlines()
    assert process.wait() == 0
    refused = [line for line in lines if not line[0].isdigit()]
    assert [line.split(":")[0] for line in refused] == ["refused", "close"]
    reason = {"mcap": "File too large", "sqlite3": "disk I/O error"}[storage]
    for line in refused:
        assert f"bag {bag} cannot be written any further: {reason}; " in line
    assert_child_wrote(bag, 200)
    recover(bag)
    assert_child_wrote(bag, 200)
