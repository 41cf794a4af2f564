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

"""Reading runs: other people's bags, faults of every kind, cut files."""

import os
import shutil
import tempfile
from dataclasses import replace
from errno import ENOLCK
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_helpers import (
    STORE,
    assert_prefix,
    assert_same,
    messages,
    serialised,
    storage_file,
    write_messages,
    written_by_rosbags,
)
from craft_helpers import configs
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as PlainMcapWriter
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from synthetic import SAMPLED, normal_run, with_parameters

from ppc_attitude.bags.changes import encode_changes
from ppc_attitude.bags.custom_data import of_namespace
from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.folder import Bag
from ppc_attitude.bags.reader import read_run, read_runs
from ppc_attitude.bags.recover import recover
from ppc_attitude.bags.run_writer import write_run
from ppc_attitude.bags.storage import KillSafeWriter
from ppc_attitude.bags.writer import BagWriter
from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.declared import BY_NAME
from ppc_attitude.contract.run_record import Change
from ppc_attitude.contract.topics import ATTITUDE, CHANGES_TOPIC, CONTROLLER, PLANT, TORQUE_COMMAND
from ppc_attitude.science.kinds import CONTROLLERS
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import load, scenario

RUN = normal_run(duration=1.0)
STEPS = len(RUN.stamps_ns)


def test_a_run_comes_back_to_the_last_bit_without_a_temporary_folder(
    tmp_path: Path, storage: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_run(RUN, tmp_path / "bag", storage=storage)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))
    read = read_run(tmp_path / "bag")
    assert_same(read, RUN)
    assert (read.controller, read.warnings, read.missing) == ("ppc", (), {})
    assert read.parameters == RUN.parameters
    assert read.metadata == RUN.metadata
    assert read.source == str(tmp_path / "bag")


@pytest.mark.parametrize(("duration", "told"), [(1.0, ()), (1.01, ("1.01 s",)), (0.0, ())])
def test_a_whole_bag_of_a_run_that_ended_early_says_so(
    tmp_path: Path, duration: float, told: tuple[str, ...]
) -> None:
    write_run(with_parameters(RUN, PLANT, {"duration": duration}), tmp_path / "bag")
    assert read_run(tmp_path / "bag").warnings == tuple(
        f"the record ends at 1 s, before the plant's duration of {each}: events scheduled after "
        "its end are not in it"
        for each in told
    )
    (tmp_path / "bag" / "metadata.yaml").unlink()
    (cut,) = read_run(tmp_path / "bag").warnings
    assert cut.startswith("recording was cut")


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_of_a_compressed_file_no_copy_outlasts_a_kill(
    tmp_path: Path, storage: StoragePlugin, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = written_by_rosbags(tmp_path / "bag", storage, CompressionMode.FILE, RUN)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    for _ in Bag(bag).blocks():
        assert not list((tmp_path / "temporary").iterdir())


@pytest.mark.parametrize(
    ("amid", "step"), [(BagWriter, "add_topic"), (BagWriter, "write"), (KillSafeWriter, "close")]
)
def test_an_end_while_a_run_is_written_leaves_no_half_of_it(
    tmp_path: Path, storage: str, monkeypatch: pytest.MonkeyPatch, amid: type, step: str
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(amid, step, interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_run(RUN, tmp_path / "bag", storage=storage)
    assert not list(tmp_path.iterdir())


def test_only_a_sample_of_which_nothing_is_known_is_no_message(tmp_path: Path) -> None:
    run = normal_run(duration=0.1)
    run["torque_command"][3], run["torque_command"][5, 0] = np.nan, np.nan
    write_run(run, tmp_path / "bag")
    read = read_run(tmp_path / "bag")
    assert_same(read, run)
    assert read.missing == {"torque_command": 1}


def test_where_nothing_can_be_locked_none_is_being_recorded_and_none_can_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on some network file systems."""

    def refuse(*_: object) -> None:
        raise OSError(ENOLCK, os.strerror(ENOLCK))

    write_run(RUN, tmp_path / "bag")
    (tmp_path / "bag" / "metadata.yaml").unlink()
    monkeypatch.setattr("fcntl.flock", refuse)
    assert read_run(tmp_path / "bag").warnings[0].startswith("recording was cut")
    with pytest.raises(BagError, match=f"cannot be made: {os.strerror(ENOLCK)}"):
        BagWriter(tmp_path / "another")


def test_a_storage_file_says_alone_what_the_bag_says_of_its_run(
    tmp_path: Path, storage: str
) -> None:
    """It has a copy of ``metadata.yaml``, so that a bag without this can be recovered."""
    write_run(RUN, tmp_path / "bag", storage=storage)
    (tmp_path / "bag" / "metadata.yaml").unlink()
    alone = read_run(storage_file(tmp_path / "bag"))
    recover(tmp_path / "bag")
    for read in (alone, read_run(tmp_path / "bag")):
        assert_same(read, RUN)
        facts = (read.controller, read.parameters, read.metadata)
        assert facts == (RUN.controller, RUN.parameters, RUN.metadata)


def test_a_run_in_a_namespace_has_the_parameters_of_its_own_nodes(tmp_path: Path) -> None:
    nodes = {
        "/a/ppc_controller": {"controller": "log_barrier"},
        "/b/c/ppc_controller": {"controller": "quaternion_feedback"},
        "spacecraft_plant": {"rate": 100.0},
    }
    run = replace(RUN, parameters=nodes)
    bag = write_messages(tmp_path / "bag", list(messages(run)), namespaces=("/a", "/b/c"), run=run)
    with pytest.raises(BagError, match=r"holds 2 runs; choose a namespace: /a, /b/c"):
        read_run(bag)
    with pytest.raises(BagError, match=r"has no run in the namespace /foo; it has: /a, /b/c"):
        read_run(bag, namespace="foo")
    assert [each.source for each in read_runs(bag)] == [f"{bag} /a", f"{bag} /b/c"]
    assert read_run(bag, namespace="/a").controller == "log_barrier"
    read = read_run(bag, namespace="b/c/")
    assert_same(read, run)
    assert read.controller == "quaternion_feedback"
    assert read.parameters == {
        "ppc_controller": {"controller": "quaternion_feedback"},
        "spacecraft_plant": {"rate": 100.0},
    }


def test_a_package_that_has_another_version_here_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    others = {"acme": "2.0", "same": "1.0", "since": "3.0"}
    monkeypatch.setattr(f"{read_run.__module__}.versions_of_others", lambda: others)
    run = replace(RUN, metadata={"acme": "1.0", "same": "1.0"})
    write_run(run, tmp_path / "bag")
    (told,) = read_run(tmp_path / "bag").warnings
    assert told.startswith(
        "package acme was 1.0 in the run and is 2.0 here: its columns and parameters are read as"
    )


def test_an_attitude_of_an_unknown_part_makes_no_run_of_its_own(tmp_path: Path) -> None:
    coarse = replace(ATTITUDE, name="coarse/attitude")
    parts = [(coarse, stamp, data) for topic, stamp, data in messages(RUN) if topic == ATTITUDE]
    bag = write_messages(tmp_path / "bag", [*messages(RUN), *parts], run=RUN)
    assert_same(read_run(bag), RUN)


@pytest.mark.parametrize("namespace", ["", "/reference", "/x/control"])
def test_the_only_namespace_is_found(tmp_path: Path, namespace: str) -> None:
    bag = write_messages(tmp_path / "bag", list(messages(RUN)), namespaces=(namespace,))
    assert_same(read_run(bag), RUN)


# What others write


@pytest.mark.parametrize("frame", ["", "inertia", "world", "inertial_2"])
def test_messages_that_a_node_refuses_for_their_frame_are_counted(
    tmp_path: Path, frame: str
) -> None:
    other = Codec(replace(ATTITUDE, frame_id=frame))
    sequence = list(messages(RUN))
    for k in [k for k, (topic, *_) in enumerate(sequence) if topic == ATTITUDE][10:13]:
        topic, stamp, data = sequence[k]
        sequence[k] = topic, stamp, other.encode(stamp, Codec(topic).decode(data).values)
    read = read_run(write_messages(tmp_path / "bag", sequence))
    assert_same(read, RUN)
    told = "3 messages of /attitude are read as if their frame were right: frame_id"
    assert read.warnings == (f"{told} {frame!r}; allowed: 'inertial'",)


def test_quaternions_that_a_node_refuses_for_their_norm_are_counted(tmp_path: Path) -> None:
    sequence = list(messages(RUN))
    states = [k for k, (topic, *_) in enumerate(sequence) if topic == ATTITUDE]
    sizes = [*[0.0] * 10, *[1.05] * 3]  # zeros are sent as long as no attitude is known
    for k, size in zip(states, sizes, strict=False):
        topic, stamp, data = sequence[k]
        values = Codec(topic).decode(data).values
        sequence[k] = topic, stamp, Codec(topic).encode(stamp, [size * each for each in values])
    (told,) = read_run(write_messages(tmp_path / "bag", sequence)).warnings
    norm = "have another norm than 1, such as 1.05; allowed: 1 within 0.001"
    assert told == f"3 quaternions of /attitude {norm}"


def test_a_node_that_is_named_with_its_namespace_goes_before_one_without() -> None:
    for nodes in ({"n": 1, "/a/n": 2, "/b/n": 3}, {"/b/n": 3, "/a/n": 2, "n": 1}):
        assert [of_namespace(nodes, home)["n"] for home in ("/a", "/b", "/c")] == [2, 3, 1]


def test_a_node_without_a_namespace_is_of_no_run_that_has_one() -> None:
    nodes = {"/n": 1, "/a/m": 2}
    assert [of_namespace(nodes, home) for home in ("", "/a")] == [{"n": 1}, {"m": 2}]
    assert of_namespace({"/n": 1, "n": 2}, "") == {"n": 1}


def test_messages_in_either_byte_order_with_frame_names_of_all_lengths(tmp_path: Path) -> None:
    sequence = []
    for count, (topic, stamp, data) in enumerate(messages(RUN)):
        message: Any = STORE.deserialize_cdr(data, topic.msgtype)
        message.header.frame_id = "n" * (count % 41)
        sequence.append((topic, stamp, serialised(message, little_endian=count // 3 % 2 == 0)))
    read = read_run(write_messages(tmp_path / "bag", sequence))
    assert_same(read, RUN)
    assert len(read.warnings) == len(RUN.columns)  # none has its own frame
    assert all(each.startswith(f"{STEPS} messages of /") for each in read.warnings)


# SQLite has no compression of its own.
COMPRESSED = set(product(StoragePlugin, CompressionMode)) - {
    (StoragePlugin.SQLITE3, CompressionMode.STORAGE)
}


@pytest.mark.parametrize(("storage", "mode"), sorted(COMPRESSED, key=str))
def test_bags_of_others_compressed_or_not(
    tmp_path: Path, storage: StoragePlugin, mode: CompressionMode
) -> None:
    read = read_run(written_by_rosbags(tmp_path / "bag", storage, mode, RUN))
    assert_same(read, RUN)
    assert read.warnings == ()


@pytest.mark.parametrize("chunking", [True, False])
@pytest.mark.parametrize("compression", list(CompressionType))
def test_mcap_files_of_others(tmp_path: Path, compression: CompressionType, chunking: bool) -> None:
    file = tmp_path / "run.mcap"
    writer = PlainMcapWriter(
        str(file), compression=compression, use_chunking=chunking, chunk_size=10_000
    )
    writer.start(profile="ros2")
    channels = {}
    for topic in SAMPLED:
        schema = writer.register_schema(topic.msgtype, "ros2msg", b"")
        channels[topic] = writer.register_channel(f"/{topic.name}", "cdr", schema)
    other = writer.register_channel(f"/{topic.name}", "json", schema)
    for topic, stamp, data in messages(RUN):
        writer.add_message(channels[topic], stamp, data, stamp)
        writer.add_message(other, stamp, b"{}", stamp)
    writer.finish()
    read = read_run(file)
    assert_same(read, RUN)
    told = f"{STEPS * len(SAMPLED)} messages of /{SAMPLED[-1].name} have no readable value, or a "
    assert read.warnings == (f"{told}stamp below 0: left out",)
    if chunking:  # the checksum of a chunk is checked
        with file.open("rb") as opened:
            summary = make_reader(opened).get_summary()
        assert summary is not None
        chunk = summary.chunk_indexes[len(summary.chunk_indexes) // 2]
        damaged = bytearray(file.read_bytes())
        damaged[chunk.chunk_start_offset + chunk.chunk_length - 100] ^= 0xFF
        file.write_bytes(damaged)
        read = read_run(file)
        assert_prefix(read, RUN)
        assert 0 < max(read.missing.values()) < STEPS / 4
        assert "a chunk of run.mcap is left out: " in read.warnings[0]


def test_a_bag_split_into_files(tmp_path: Path) -> None:
    sequence = list(messages(RUN))
    third = len(sequence) // 3
    parts = [sequence[:third], sequence[third : 2 * third], sequence[2 * third :]]
    (tmp_path / "bag").mkdir()
    for number, part in zip((2, 9, 10), parts, strict=True):
        one = write_messages(tmp_path / f"part{number}", part)
        shutil.copy(storage_file(one), tmp_path / "bag" / f"bag_{number}.mcap")
    assert_same(read_run(tmp_path / "bag"), RUN)


def test_a_file_that_was_renamed_is_told_from_a_folder_without_a_bag(tmp_path: Path) -> None:
    bag = write_messages(tmp_path / "bag", list(messages(RUN)), run=RUN)
    file = storage_file(bag)
    file.rename(file.with_name("other.mcap"))
    with pytest.raises(BagError, match=rf"lacks {file.name} of its metadata.yaml, and holds other"):
        read_run(bag)


@pytest.mark.parametrize("msgtype", [BY_NAME["wheels/speed"].msgtype, "std_msgs/msg/Float64"])
def test_topics_that_no_component_of_the_run_gives_are_missed_by_nobody(
    tmp_path: Path, msgtype: str
) -> None:
    """Another craft's node may have the name of one of our topics."""
    run = replace(RUN, parameters=scenario({PLANT: {"duration": 1.0}}).parameters)
    wheels = BY_NAME["wheels/speed"]
    codec, stranger = Codec(wheels), replace(wheels, msgtype=msgtype)
    sequence = list(messages(run))
    for stamp in run.stamps_ns[::10].tolist():
        sequence.append((stranger, stamp, codec.encode(stamp, (0.0,) * wheels.width)))
    write_messages(tmp_path / "bag", sequence, run=run)
    read = read_run(tmp_path / "bag", whole=True)
    assert sum(read.missing.values()) == 0


def test_what_a_bridge_of_the_users_sends_to_our_filter_is_missed(tmp_path: Path) -> None:
    run = simulate(load(configs("paper", "sensors_smallsat")), 1.0)
    run = with_parameters(run, PLANT, {"sensors": "direct"})
    lost = set(run.stamps_ns[10:15].tolist())
    sequence = [each for each in messages(run) if each[0].column != "gyro" or each[1] not in lost]
    read = read_run(write_messages(tmp_path / "bag", sequence, run=run))
    assert sum(read.missing.values()) == 5


def test_what_another_law_does_not_give_is_missing_in_no_run_that_went_on_with_it(
    tmp_path: Path,
) -> None:
    """Its node was started again with it: first in the middle of a run, then time began again."""
    run = simulate(load(configs("paper")), 1.0)
    half = int(run.stamps_ns[50])
    of_ppc, of_other = (
        {each.name for each in CONTROLLERS.components[law].outputs}
        for law in ("ppc", "quaternion_feedback")
    )
    own = of_ppc - of_other
    told = encode_changes([Change(half, CONTROLLER, "controller", "quaternion_feedback")])
    first = [each for each in messages(run) if each[1] < half or each[0].column not in own]
    sequence = [*first, *((CHANGES_TOPIC, *each) for each in told)]
    read = read_run(write_messages(tmp_path / "once", sequence, run=run), whole=True)
    assert (read.controller, sum(read.missing.values())) == ("ppc", 0)
    sequence += [each for each in messages(run) if each[0].column not in own]
    read = read_run(write_messages(tmp_path / "again", sequence, run=run), whole=True)
    assert (read.controller, sum(read.missing.values())) == ("quaternion_feedback", 0)
    assert not own & set(read.columns)


def test_a_plant_that_was_started_again_at_another_rate_lacks_no_instants(tmp_path: Path) -> None:
    late, slow = int(RUN.stamps_ns[-1]), (("rate", 100.0), ("enabled", True))
    told = encode_changes([Change(late, PLANT, name, value) for name, value in slow])
    sequence = [*messages(RUN), *((CHANGES_TOPIC, *each) for each in told), *messages(RUN)]
    fast = with_parameters(RUN, PLANT, {"rate": 1000.0})
    read = read_run(write_messages(tmp_path / "bag", sequence, run=fast))
    assert np.array_equal(read.stamps_ns, RUN.stamps_ns)


def test_a_topic_of_another_type_is_named(tmp_path: Path) -> None:
    text = {TORQUE_COMMAND: replace(TORQUE_COMMAND, msgtype="std_msgs/msg/String")}
    sequence = [(text.get(topic, topic), stamp, data) for topic, stamp, data in messages(RUN)]
    write_messages(tmp_path / "bag", sequence, run=RUN)
    expected = (
        r"torque_command \(its type is std_msgs/msg/String; allowed: geometry_msgs/msg/WrenchSt"
    )
    with pytest.raises(BagError, match=expected):
        read_run(tmp_path / "bag", whole=True)
    (warning,) = read_run(tmp_path / "bag").warnings
    assert "lacks messages of torque_command (its type is std_msgs/msg/String; " in warning
