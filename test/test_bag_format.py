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

"""Our bags beside what rosbag2 of Jazzy writes and reads: metadata version 9, MCAP, SQLite."""

import json
import os
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from bag_helpers import STORE, database_of, storage_file
from mcap.reader import make_reader
from packaging.specifiers import SpecifierSet
from rosbags.rosbag2 import Reader
from synthetic import SAMPLED, normal_run

from ppc_attitude.bags.run_writer import write_run
from ppc_attitude.bags.writer import BagWriter, offered_qos
from ppc_attitude.contract.cdr import Codec, encode_clock
from ppc_attitude.contract.declared import TOPICS
from ppc_attitude.contract.topics import ATTITUDE

FOREVER = {"sec": 9223372036, "nsec": 854775807}
SECOND = 1_000_000_000


def test_the_installed_rosbags_is_one_whose_internals_are_known() -> None:
    # `bags/storage.py` overrides methods of rosbags' writers; these versions have been tried.
    assert version("rosbags") in SpecifierSet(">=0.11.9,<0.12")


def test_metadata_field_by_field(tmp_path: Path, storage: str) -> None:
    bag = tmp_path / "bag"
    codec = Codec(ATTITUDE)
    with BagWriter(bag, storage=storage, custom_data={"a": "1"}) as writer:
        writer.add_topic("/attitude", ATTITUDE.msgtype, [offered_qos(depth=7)])
        writer.add_topic(
            "/clock",
            "rosgraph_msgs/msg/Clock",
            [offered_qos(reliability="BEST_EFFORT", durability="TRANSIENT_LOCAL", depth=1)],
        )
        writer.add_topic("/silent", "std_msgs/msg/String")
        for time in (5 * SECOND, 3 * SECOND, 9 * SECOND):
            writer.write("/attitude", time, codec.encode(time, (0.0, 0.0, 0.0, 1.0)))
        writer.write("/clock", 4 * SECOND, encode_clock(4 * SECOND))
        writer.set_custom_data("b", "zwei")

    def topic(name: str, msgtype: str, count: int, qos: list[dict[str, object]]) -> object:
        return {
            "topic_metadata": {
                "name": name,
                "type": msgtype,
                "serialization_format": "cdr",
                "offered_qos_profiles": qos,
                "type_description_hash": STORE.hash_rihs01(msgtype),
            },
            "message_count": count,
        }

    def qos(reliability: str, durability: str, depth: int) -> dict[str, object]:
        return {
            "history": "keep_last",
            "depth": depth,
            "reliability": reliability,
            "durability": durability,
            "deadline": FOREVER,
            "lifespan": FOREVER,
            "liveliness": "automatic",
            "liveliness_lease_duration": FOREVER,
            "avoid_ros_namespace_conventions": False,
        }

    name = storage_file(bag).name
    assert name == {"mcap": "bag.mcap", "sqlite3": "bag.db3"}[storage]
    assert yaml.safe_load((bag / "metadata.yaml").read_text()) == {
        "rosbag2_bagfile_information": {
            "version": 9,
            "storage_identifier": storage,
            "duration": {"nanoseconds": 6 * SECOND},
            "starting_time": {"nanoseconds_since_epoch": 3 * SECOND},
            "message_count": 4,
            "topics_with_message_count": [
                topic("/attitude", ATTITUDE.msgtype, 3, [qos("reliable", "volatile", 7)]),
                topic(
                    "/clock",
                    "rosgraph_msgs/msg/Clock",
                    1,
                    [qos("best_effort", "transient_local", 1)],
                ),
                topic("/silent", "std_msgs/msg/String", 0, []),
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [name],
            "files": [
                {
                    "path": name,
                    "starting_time": {"nanoseconds_since_epoch": 3 * SECOND},
                    "duration": {"nanoseconds": 6 * SECOND},
                    "message_count": 4,
                }
            ],
            "custom_data": {"a": "1", "b": "zwei"},
            "ros_distro": "rosbags",
        }
    }
    assert sorted(file.name for file in bag.iterdir()) == sorted([name, "metadata.yaml"])


def test_rosbags_reads_every_message_with_its_definition(tmp_path: Path, storage: str) -> None:
    run = normal_run(duration=0.5)
    write_run(run, tmp_path / "bag", storage=storage)
    with Reader(tmp_path / "bag") as reader:
        connections = {connection.topic: connection for connection in reader.connections}
        for topic in SAMPLED:
            connection = connections[f"/{topic.name}"]
            definition, _ = STORE.generate_msgdef(topic.msgtype, ros_version=2)
            assert connection.msgdef.data == definition
            assert connection.msgcount == len(run.stamps_ns)
        read = [
            STORE.deserialize_cdr(data, ATTITUDE.msgtype)
            for _, _, data in reader.messages([connections["/attitude"]])
        ]
        clock = [
            STORE.deserialize_cdr(data, "rosgraph_msgs/msg/Clock").clock
            for _, _, data in reader.messages([connections["/clock"]])
        ]
    values = [[getattr(message.quaternion, axis) for axis in "xyzw"] for message in read]
    np.testing.assert_array_equal(values, run["attitude"])
    assert {message.header.frame_id for message in read} == {"inertial"}
    assert [each.sec * SECOND + each.nanosec for each in clock] == run.stamps_ns.tolist()


def information_of(bag: Path) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """What ``metadata.yaml`` says, and what of every topic, by name."""
    content = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    topics = [entry["topic_metadata"] for entry in content["topics_with_message_count"]]
    return content, {topic["name"]: topic for topic in topics}


def test_an_mcap_file_says_alone_what_rosbag2_would_write_into_it(tmp_path: Path) -> None:
    """`ros2 bag` reads channels and the record "rosbag2", and metadata.yaml where there is one."""
    run = normal_run(duration=0.5)
    write_run(run, tmp_path / "bag")
    outside, topics = information_of(tmp_path / "bag")
    with storage_file(tmp_path / "bag").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        assert summary.chunk_indexes
        assert summary.statistics.message_count == 15 * len(run.stamps_ns)
        assert summary.statistics.message_end_time == run.stamps_ns[-1]
        assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
        read = [message for _, _, message in reader.iter_messages(topics=["/attitude"])]
        (record,) = reader.iter_metadata()
    assert [message.log_time for message in read] == run.stamps_ns.tolist()
    channels = {channel.topic: channel for channel in summary.channels.values()}
    assert set(channels) == set(topics)
    for name, channel in channels.items():
        assert set(channel.metadata) == {"offered_qos_profiles", "topic_type_hash"}
        profiles = yaml.safe_load(channel.metadata["offered_qos_profiles"])
        assert profiles == topics[name]["offered_qos_profiles"] != []
        assert channel.metadata["topic_type_hash"] == topics[name]["type_description_hash"]
        assert channel.message_encoding == topics[name]["serialization_format"]
        assert summary.schemas[channel.schema_id].name == topics[name]["type"]
    assert record.name == "rosbag2"
    assert yaml.safe_load(record.metadata["serialized_metadata"]) == outside


def test_a_sqlite_file_has_the_tables_of_rosbag2(tmp_path: Path) -> None:
    write_run(normal_run(duration=0.1), tmp_path / "bag", storage="sqlite3")
    outside, topics = information_of(tmp_path / "bag")
    with database_of(tmp_path / "bag") as database:
        assert database.execute("SELECT schema_version FROM schema").fetchall() == [(4,)]
        names = "name, type, serialization_format, offered_qos_profiles, type_description_hash"
        rows = database.execute(f"SELECT {names} FROM topics").fetchall()
        definitions = database.execute(
            "SELECT topic_type, encoding, type_description_hash FROM message_definitions"
        ).fetchall()
        ((version, text),) = database.execute("SELECT metadata_version, metadata FROM metadata")
        played = database.execute(
            "SELECT data, timestamp, topics.name, messages.id FROM messages JOIN topics ON"
            " messages.topic_id = topics.id ORDER BY messages.timestamp, messages.id"
        ).fetchall()
    assert {name for name, *_ in rows} == set(topics)
    for row in rows:
        topic = dict(zip(names.split(", "), row, strict=True))
        assert topics[row[0]] == topic | {
            "offered_qos_profiles": yaml.safe_load(topic["offered_qos_profiles"])
        }
    hashes = {
        (entry["type"], "ros2msg", entry["type_description_hash"]) for entry in topics.values()
    }
    assert set(definitions) == hashes
    assert version == 9
    assert yaml.safe_load(text) == outside
    assert len(played) == outside["message_count"]


def test_types_have_the_hashes_of_the_installed_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    packages = pytest.importorskip("ament_index_python.packages")
    # A sourced ROS names itself there, one of pip does not, and a workspace over it only itself.
    prefixes = [*filter(None, [os.environ.get("AMENT_PREFIX_PATH")]), sys.prefix]
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join(prefixes))
    for msgtype in {topic.msgtype for topic in TOPICS}:
        package, _, name = msgtype.split("/")
        share = Path(packages.get_package_share_directory(package))
        description = json.loads((share / "msg" / f"{name}.json").read_text())
        hashes = {one["type_name"]: one["hash_string"] for one in description["type_hashes"]}
        assert STORE.hash_rihs01(msgtype) == hashes[msgtype]
