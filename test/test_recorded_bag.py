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

"""A bag that the recorder made of a real run is what rosbag2, rosbags and the mcap tools expect."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from rosbags.highlevel import AnyReader
from synthetic import SAMPLED

from ppc_attitude.bags.reader import read_run
from ppc_attitude.contract.topics import CLOCK_TOPIC, CONTROLLER, DIAGNOSTICS_TOPIC, NODES
from ppc_attitude.simulation.scenario import load

pytestmark = pytest.mark.ros
STEPS = 201


@pytest.fixture(scope="module")
def information(recorded_bag: Path) -> dict[str, Any]:
    content = yaml.safe_load((recorded_bag / "metadata.yaml").read_text(encoding="utf-8"))
    return dict(content["rosbag2_bagfile_information"])


def test_metadata_say_what_is_in_the_bag(information: dict[str, Any]) -> None:
    assert information["duration"]["nanoseconds"] == 2_000_000_000
    assert information["starting_time"]["nanoseconds_since_epoch"] == 0
    entries = information["topics_with_message_count"]
    found = {entry["topic_metadata"]["name"].lstrip("/"): entry for entry in entries}
    for topic in (*SAMPLED, CLOCK_TOPIC, DIAGNOSTICS_TOPIC):
        assert found[topic.name.lstrip("/")]["topic_metadata"]["type"] == topic.msgtype
    for topic in SAMPLED:
        assert found[topic.name]["message_count"] == STEPS


def test_offered_qos_lets_ros2_bag_play_republish(information: dict[str, Any]) -> None:
    for entry in information["topics_with_message_count"]:
        (profile,) = entry["topic_metadata"]["offered_qos_profiles"]
        assert profile["history"] == "keep_last"
        assert profile["depth"] >= 1
        assert profile["reliability"] == "reliable"
        assert profile["durability"] == "volatile"  # who joins late gets no history


def test_rosbags_decodes_every_message(recorded_bag: Path, information: dict[str, Any]) -> None:
    decoded = 0
    levels = set()
    with AnyReader([recorded_bag]) as reader:
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            decoded += 1
            if connection.topic == DIAGNOSTICS_TOPIC.name:
                levels |= {status.hardware_id for status in message.status}
    assert decoded == information["message_count"]
    assert {f"/{node}" for node in NODES} <= levels


def test_the_bag_knows_its_run(recorded_bag: Path) -> None:
    run = read_run(recorded_bag)
    assert run.controller == "ppc"
    told = {"wait_for_recorder": True}  # by `run`, which starts a recorder
    assert run.parameters[CONTROLLER] == {**load([]).parameters[CONTROLLER], **told}
    assert "--duration 2" in run.metadata["command"]
