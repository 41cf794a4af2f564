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

import shutil
import struct
from dataclasses import replace
from pathlib import Path
from random import Random

import numpy as np
import pytest
from bag_helpers import (
    STORAGES,
    assert_prefix,
    assert_same,
    cut_copy,
    messages,
    storage_file,
    write_messages,
)
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as PlainMcapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from synthetic import normal_run, without_columns

from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.reader import REQUIRED, read_run
from ppc_attitude.bags.writer import BagWriter, write_run
from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    APPLIED_TORQUE,
    ATTITUDE,
    BY_COLUMN,
    QUATERNION,
    SAMPLED,
    TORQUE_COMMAND,
    VECTOR,
    Topic,
)

JAZZY = get_typestore(Stores.ROS2_JAZZY)
RUN = normal_run(duration=1.0)
STEPS = len(RUN.stamps_ns)


def shifted(run: RunRecord, nanoseconds: int) -> RunRecord:
    return replace(run, stamps_ns=run.stamps_ns + nanoseconds)


@pytest.mark.parametrize("storage", STORAGES)
def test_a_run_comes_back_to_the_last_bit(tmp_path: Path, storage: str) -> None:
    write_run(RUN, tmp_path / "bag", storage=storage)
    read = read_run(tmp_path / "bag")
    assert_same(read, RUN)
    assert (read.controller, read.warnings, read.missing) == ("ppc", (), {})
    assert read.parameters == RUN.parameters
    assert read.metadata == RUN.metadata
    assert read.source == str(tmp_path / "bag")
    alone = read_run(storage_file(tmp_path / "bag"))
    assert_same(alone, RUN)
    assert alone.controller == {"mcap": "ppc", "sqlite3": "unknown"}[storage]


def test_without_custom_data_the_controller_is_unknown(tmp_path: Path) -> None:
    read = read_run(write_messages(tmp_path / "bag", list(messages(RUN))))
    assert (read.controller, read.parameters, read.metadata) == ("unknown", {}, {})
    assert_same(read, RUN)


def test_a_run_in_a_namespace_has_the_parameters_of_its_own_nodes(tmp_path: Path) -> None:
    nodes = {
        "/a/ppc_controller": {"controller": "log_barrier"},
        "/b/ppc_controller": {"controller": "quaternion_feedback"},
        "spacecraft_plant": {"rate": 100.0},
    }
    run = replace(RUN, parameters=nodes)
    bag = write_messages(tmp_path / "bag", list(messages(run)), namespaces=("/a", "/b"), run=run)
    read = read_run(bag, namespace="/b")
    assert read.controller == "quaternion_feedback"
    assert read.parameters == {
        "ppc_controller": {"controller": "quaternion_feedback"},
        "spacecraft_plant": {"rate": 100.0},
    }


@pytest.mark.parametrize("namespace", ["", "/reference", "/x/control"])
def test_the_only_namespace_is_found(tmp_path: Path, namespace: str) -> None:
    write_run(RUN, tmp_path / "bag", namespace=namespace)
    assert_same(read_run(tmp_path / "bag"), RUN)


# What others write


def typed(topic: Topic, stamp: int, values: list[float], *, little: bool, frame: str) -> bytes:
    """The message as rosbags serialises it: an implementation that is not ours."""
    types = JAZZY.types
    time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    header = types["std_msgs/msg/Header"](stamp=time, frame_id=frame)
    vector = types["geometry_msgs/msg/Vector3"]
    if topic.msgtype == QUATERNION:
        body = {"quaternion": types["geometry_msgs/msg/Quaternion"](*values)}
    elif topic.msgtype == VECTOR:
        body = {"vector": vector(*values)}
    else:
        force, torque = vector(9.0, 9.0, 9.0), vector(*values)
        body = {"wrench": types["geometry_msgs/msg/Wrench"](force=force, torque=torque)}
    message = types[topic.msgtype](header=header, **body)
    return bytes(JAZZY.serialize_cdr(message, topic.msgtype, little_endian=little))


@pytest.mark.parametrize("little", [True, False])
@pytest.mark.parametrize("frame", ["", "b", "inertial", "a_very_long_name_of_a_frame/base_link"])
def test_other_byte_orders_and_frame_names(tmp_path: Path, little: bool, frame: str) -> None:
    sequence = [
        (
            topic,
            stamp,
            typed(topic, stamp, list(Codec(topic).decode(data).values), little=little, frame=frame),
        )
        for topic, stamp, data in messages(RUN)
    ]
    assert_same(read_run(write_messages(tmp_path / "bag", sequence)), RUN)


def test_every_message_in_another_encoding(tmp_path: Path) -> None:
    """XCDR2 (float64 on 4 bytes), both byte orders and frame names of all lengths in one topic."""
    sequence = []
    for count, (topic, stamp, data) in enumerate(messages(RUN)):
        order, kind, align = [(">", 0, 8), ("<", 1, 8), (">", 6, 4), ("<", 7, 4)][count // 3 % 4]
        name = b"n" * (count % 11) + b"\0"
        head = struct.pack(
            f"{order}iII{len(name)}s", stamp // 10**9, stamp % 10**9, len(name), name
        )
        values = Codec(topic).decode(data).values
        values = (0.0,) * (3 if "Wrench" in topic.msgtype else 0) + values
        tail = struct.pack(f"{order}{len(values)}d", *values)
        pad = b"\xaa" * (-len(head) % align)
        sequence.append((topic, stamp, bytes([0, kind, 0, 0]) + head + pad + tail))
    assert_same(read_run(write_messages(tmp_path / "bag", sequence)), RUN)


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize(
    "mode",
    [
        CompressionMode.NONE,
        CompressionMode.FILE,
        CompressionMode.MESSAGE,
        CompressionMode.STORAGE,
    ],
)
def test_bags_of_others_compressed_or_not(
    tmp_path: Path, storage: StoragePlugin, mode: CompressionMode
) -> None:
    if (storage, mode) == (StoragePlugin.SQLITE3, CompressionMode.STORAGE):
        pytest.skip("SQLite has no compression of its own")
    writer = Writer(tmp_path / "bag", version=8, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {
            topic: writer.add_connection(f"/{topic.name}", topic.msgtype, typestore=JAZZY)
            for topic in SAMPLED
        }
        for topic, stamp, data in messages(RUN):
            writer.write(connections[topic], stamp, data)
    read = read_run(tmp_path / "bag")
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
    other = writer.register_channel("/attitude_raw", "json", 0)
    for topic, stamp, data in messages(RUN):
        writer.add_message(channels[topic], stamp, data, stamp)
        writer.add_message(other, stamp, b"{}", stamp)
    writer.finish()
    assert_same(read_run(file), RUN)
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
        assert 0 < len(read.stamps_ns) < STEPS
        assert "damaged" in read.warnings[0]


def test_a_bag_split_into_files(tmp_path: Path) -> None:
    sequence = list(messages(RUN))
    third = len(sequence) // 3
    parts = [sequence[:third], sequence[third : 2 * third], sequence[2 * third :]]
    (tmp_path / "bag").mkdir()
    for number, part in zip((2, 9, 10), parts, strict=True):
        one = write_messages(tmp_path / f"part{number}", part)
        shutil.copy(storage_file(one), tmp_path / "bag" / f"bag_{number}.mcap")
    assert_same(read_run(tmp_path / "bag"), RUN)


# Faults within a run


def test_of_several_messages_of_one_stamp_the_first_counts(tmp_path: Path) -> None:
    sequence = []
    for topic, stamp, data in messages(RUN):
        sequence.append((topic, stamp, data))
        if topic is TORQUE_COMMAND:
            sequence.append((topic, stamp, Codec(topic).encode(stamp, (9.0, 9.0, 9.0))))
    read = read_run(write_messages(tmp_path / "bag", sequence))
    assert_same(read, RUN)
    assert (read.missing, read.warnings) == ({}, ())


def test_a_late_message_is_put_in_its_place(tmp_path: Path) -> None:
    sequence = list(messages(RUN))
    per_step = len(SAMPLED)
    late = sequence[20 * per_step]
    again = [*sequence[: 25 * per_step], late, *sequence[25 * per_step :]]
    without = [message for message in again if message is not late]
    delayed = [*without[: 25 * per_step], late, *without[25 * per_step :]]
    for count, one in enumerate((again, delayed)):
        read = read_run(write_messages(tmp_path / f"bag{count}", one))
        assert_same(read, RUN)
        assert read.warnings == ("1 messages of attitude arrived out of order",)
        assert read.missing == {}


@pytest.mark.parametrize("with_rate", [True, False])
def test_gaps_are_nan_and_counted(tmp_path: Path, with_rate: bool) -> None:
    """Instants 40 to 42 lack everything, 50 lacks the plant, 60 to 64 the command."""
    lost = [
        *((topic, step) for topic in SAMPLED for step in (40, 41, 42)),
        *((topic, 50) for topic in (ATTITUDE, ANGULAR_VELOCITY, APPLIED_TORQUE)),
        *((TORQUE_COMMAND, step) for step in range(60, 65)),
    ]
    lost_stamps = {(topic, int(RUN.stamps_ns[step])) for topic, step in lost}
    sequence = [one for one in messages(RUN) if (one[0], one[1]) not in lost_stamps]
    bag = write_messages(tmp_path / "bag", sequence, run=RUN if with_rate else None)
    read = read_run(bag)
    np.testing.assert_array_equal(read.stamps_ns, RUN.stamps_ns)
    plant = {"attitude": 4, "angular_velocity": 4, "applied_torque": 4, "torque_command": 8}
    assert read.missing == {topic.name: plant.get(topic.name, 3) for topic in SAMPLED}
    assert read.missing_messages == len(lost)
    assert read.warnings == ()
    for topic in SAMPLED:
        gone = [step for one, step in lost if one is topic]
        expected = RUN[topic.column].copy()
        expected[gone] = np.nan
        np.testing.assert_array_equal(read[topic.column], expected, err_msg=topic.name)


def test_gaps_of_a_rate_without_whole_nanoseconds(tmp_path: Path) -> None:
    """The stamps filled in are those that the other topics have."""
    run = normal_run(duration=1.0, rate=300.0)
    lost = set(run.stamps_ns[[31, 32, 200]].tolist())
    sequence = [
        one
        for one in messages(run)
        if one[0] not in (ATTITUDE, ANGULAR_VELOCITY, APPLIED_TORQUE) or one[1] not in lost
    ]
    read = read_run(write_messages(tmp_path / "bag", sequence, run=run))
    np.testing.assert_array_equal(read.stamps_ns, run.stamps_ns)
    assert read.missing == {"attitude": 3, "angular_velocity": 3, "applied_torque": 3}
    np.testing.assert_array_equal(read["torque_command"], run["torque_command"])


def test_a_leap_of_the_clock_is_not_filled_in(tmp_path: Path) -> None:
    """A wrong clock must not make the reader allocate a century of NaN."""
    far = shifted(RUN, 10**18)
    read = read_run(write_messages(tmp_path / "bag", [*messages(RUN), *messages(far)], run=RUN))
    assert len(read.stamps_ns) == 2 * STEPS
    assert read.missing["attitude"] == 10**11 - STEPS
    assert any("left out of the record" in warning for warning in read.warnings)


def test_messages_beside_the_plants_stamps_are_reported(tmp_path: Path) -> None:
    sequence = list(messages(RUN))
    stray = (TORQUE_COMMAND, 5, Codec(TORQUE_COMMAND).encode(5, (1.0, 1.0, 1.0)))
    read = read_run(write_messages(tmp_path / "bag", [*sequence[:60], stray, *sequence[60:]]))
    assert_same(read, RUN)
    assert "1 messages of torque_command have no stamp of the plant's" in read.warnings


@pytest.mark.parametrize("steps", [[30, STEPS], [30, 50, STEPS], [STEPS, 20]])
def test_after_a_reset_the_last_epoch_is_read(tmp_path: Path, steps: list[int]) -> None:
    """Each epoch has other numbers; the last command of an epoch arrives in the next."""
    sequence: list = []
    for epoch, count in enumerate(steps):
        run = replace(RUN, columns={k: v + epoch for k, v in RUN.columns.items()})
        part = list(messages(run))[: count * len(SAMPLED)]
        if sequence:
            held = sequence.pop()
            part.insert(2, held)
        sequence += part
    read = read_run(write_messages(tmp_path / "bag", sequence, run=RUN))
    last = steps[-1]
    np.testing.assert_array_equal(read.stamps_ns, RUN.stamps_ns[:last])
    for column in RUN.columns:
        expected = RUN[column][:last] + (len(steps) - 1)
        np.testing.assert_array_equal(read[column], expected, err_msg=column)
    times = "time" if len(steps) == 2 else "times"
    assert f"the clock went back {len(steps) - 1} {times}" in read.warnings[0]
    assert "to 0 s (plant reset or restarted)" in read.warnings[0]


def test_undecodable_messages_are_counted(tmp_path: Path) -> None:
    sequence = list(messages(RUN))
    sequence[3 * len(SAMPLED)] = (ATTITUDE, 0, b"\0\1\0\0short")
    read = read_run(write_messages(tmp_path / "bag", sequence, run=RUN))
    assert read.warnings == ("1 messages of /attitude cannot be decoded",)
    assert read.missing == {"attitude": 1}
    assert np.isnan(read["attitude"][3]).all()


def test_optional_topics_may_be_absent(tmp_path: Path) -> None:
    run = without_columns(RUN, "attitude_envelope", "rate_envelope", "auxiliary_state")
    write_run(run, tmp_path / "bag")
    read = read_run(tmp_path / "bag")
    assert_same(read, run)
    assert "attitude_envelope" not in read


# Bags that are none


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("topic", REQUIRED, ids=lambda topic: topic.name)
def test_a_lacking_topic_is_named_with_what_was_read(
    tmp_path: Path, storage: str, topic: Topic
) -> None:
    write_run(without_columns(RUN, topic.column), tmp_path / "bag", storage=storage)
    with pytest.raises(BagError) as error:
        read_run(tmp_path / "bag")
    message = str(error.value)
    assert f"lacks messages of {topic.name}; messages read: " in message
    for other in set(SAMPLED) - {topic}:
        assert f"{other.name} ({STEPS})" in message


def test_a_topic_of_another_type_is_named(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        for topic in SAMPLED:
            msgtype = "std_msgs/msg/String" if topic is TORQUE_COMMAND else topic.msgtype
            writer.add_topic(f"/{topic.name}", msgtype)
        for topic, stamp, data in messages(RUN):
            writer.write(f"/{topic.name}", stamp, data)
    expected = r"torque_command \(it is std_msgs/msg/String instead of geometry_msgs/msg/Wrench"
    with pytest.raises(BagError, match=expected):
        read_run(tmp_path / "bag")


def test_what_is_no_bag_is_refused_by_name(tmp_path: Path) -> None:
    def refused(path: Path, message: str) -> None:
        with pytest.raises(BagError, match=message):
            read_run(path)

    refused(tmp_path / "nowhere", "nowhere does not exist")
    (tmp_path / "empty").mkdir()
    refused(tmp_path / "empty", "is an empty folder")
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "notes.txt").write_text("no bag")
    refused(tmp_path / "notes", r"is no bag: it holds no \.mcap or \.db3 file")
    refused(tmp_path / "notes" / "notes.txt", r"is no bag: not a folder, \.mcap or \.db3")
    for suffix, message in (
        (".mcap", "is no MCAP file"),
        (".db3", "cannot be read as a rosbag2 database"),
    ):
        file = tmp_path / f"text{suffix}"
        file.write_text("no storage, but some text that is long enough to look like one")
        refused(file, message)
        file.write_bytes(b"")
        refused(file, "is empty")
    (tmp_path / "gone").mkdir()
    (tmp_path / "gone" / "metadata.yaml").write_text(
        "rosbag2_bagfile_information: {version: 9, relative_file_paths: [gone.mcap]}"
    )
    refused(tmp_path / "gone", "is no bag: it holds no")


@pytest.mark.parametrize("storage", STORAGES)
def test_empty_and_foreign_bags(tmp_path: Path, storage: str) -> None:
    with BagWriter(tmp_path / "silent", storage=storage) as writer:
        writer.add_topic("/attitude", ATTITUDE.msgtype)
    with pytest.raises(BagError, match="silent holds no messages"):
        read_run(tmp_path / "silent")
    with BagWriter(tmp_path / "foreign", storage=storage) as writer:
        writer.add_topic("/chatter", "std_msgs/msg/String")
        writer.write("/chatter", 1, b"\0\1\0\0\1\0\0\0\0")
    with pytest.raises(
        BagError, match=r"is no run of this package; it holds /chatter \(std_msgs/msg/String\)"
    ):
        read_run(tmp_path / "foreign")


@pytest.mark.parametrize("text", ["{", "- a\n- b", "rosbag2_bagfile_information: 3", "\x00", ""])
def test_damaged_metadata_are_a_warning(tmp_path: Path, text: str) -> None:
    write_run(RUN, tmp_path / "bag")
    (tmp_path / "bag" / "metadata.yaml").write_text(text)
    read = read_run(tmp_path / "bag")
    assert_same(read, RUN)
    assert read.warnings[0].startswith("recording was cut: its metadata.yaml is damaged")
    assert read.controller == "ppc"


# Cut files


@pytest.fixture(scope="module", params=STORAGES)
def whole(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag with several chunks."""
    bag = tmp_path_factory.mktemp("whole") / "bag"
    with BagWriter(bag, storage=request.param) as writer:
        for topic in SAMPLED:
            writer.add_topic(f"/{topic.name}", topic.msgtype)
        for count, (topic, stamp, data) in enumerate(messages(RUN)):
            writer.write(f"/{topic.name}", stamp, data)
            if count % 200 == 199:
                writer.flush()
    return bag


@pytest.mark.parametrize("with_metadata", [True, False])
def test_a_file_cut_anywhere_is_read_or_refused(
    tmp_path: Path, whole: Path, with_metadata: bool
) -> None:
    size = storage_file(whole).stat().st_size
    random = Random(1)
    sizes = {*range(80), *(random.randrange(size) for _ in range(150)), *range(size - 60, size)}
    longest = 0
    for length in sorted(sizes):
        bag = cut_copy(whole, tmp_path / "cut", length, with_metadata=with_metadata)
        try:
            run = read_run(bag)
        except BagError:
            continue
        assert_prefix(run, RUN)
        assert run.warnings[0].startswith("recording was cut: "), length
        assert len(run.stamps_ns) >= longest
        longest = max(longest, len(run.stamps_ns))
    if storage_file(whole).suffix == ".mcap":
        assert longest == STEPS


def test_a_cut_mcap_file_gives_every_whole_message(tmp_path: Path, whole: Path) -> None:
    if storage_file(whole).suffix != ".mcap":
        pytest.skip("pages of a SQLite file depend on each other")
    content = storage_file(whole).read_bytes()
    place = content.index(Codec(ATTITUDE).encode(RUN.stamps_ns[70], tuple(RUN["attitude"][70])))
    run = read_run(cut_copy(whole, tmp_path / "cut", place))
    np.testing.assert_array_equal(run.stamps_ns, RUN.stamps_ns[:70])
    assert run.missing == {}


def test_flipped_bits_raise_nothing_but_bag_errors(tmp_path: Path, whole: Path) -> None:
    content = storage_file(whole).read_bytes()
    random = Random(2)
    bag = cut_copy(whole, tmp_path / "bag", len(content), with_metadata=True)
    for _ in range(200):
        damaged = bytearray(content)
        for _ in range(random.choice((1, 3, 30))):
            damaged[random.randrange(len(damaged))] ^= 1 << random.randrange(8)
        storage_file(bag).write_bytes(damaged)
        try:
            run = read_run(bag)
        except BagError:
            continue
        assert set(run.columns) <= set(BY_COLUMN)
        assert (np.diff(run.stamps_ns) > 0).all()
