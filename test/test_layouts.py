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

"""What the layouts for RViz, Foxglove and PlotJuggler show is what a run records."""

import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import pytest
import yaml
from craft_helpers import CONFIG
from rosbags.highlevel import AnyReader

from ppc_attitude.contract.declared import BY_NAME
from ppc_attitude.contract.topics import GOAL_POSE, GUIDANCE_STATUS, MARKERS_TOPIC
from ppc_attitude.nodes.messages import message_class
from ppc_attitude.science.component import INERTIAL


@pytest.fixture(scope="module")
def samples(recorded_bag: Path) -> dict[str, Any]:
    """Topic to the last message of it in a recorded run."""
    found: dict[str, Any] = {}
    with AnyReader([recorded_bag]) as reader:
        for connection, _, data in reader.messages():
            found[connection.topic] = reader.deserialize(data, connection.msgtype)
    return found


@pytest.fixture(scope="module")
def foxglove() -> dict[str, Any]:
    return dict(json.loads((CONFIG / "foxglove_layout.json").read_text(encoding="utf-8")))


def assert_recorded(topic: str, fields: list[str], samples: dict[str, Any]) -> None:
    """The topic is in the bag with the declared type, and its message has the field, a number."""
    assert topic in samples, f"{topic} is not recorded"
    declared = BY_NAME[topic.lstrip("/")].msgtype
    assert samples[topic].__msgtype__ == declared
    value = samples[topic]
    ours = message_class(declared)()
    for field in fields:
        value, ours = getattr(value, field), getattr(ours, field)
    assert isinstance(value, float)
    assert isinstance(ours, float)


def test_foxglove_plots_what_is_recorded(foxglove: dict[str, Any], samples: dict[str, Any]) -> None:
    panels = foxglove["configById"].values()
    series = [each["value"] for panel in panels for each in panel.get("paths", [])]
    assert series
    for each in series:
        path, _, modifier = each.partition(".@")
        topic, *fields = path.split(".")
        assert_recorded(topic, fields, samples)
        assert modifier in ("", "negative")


def test_foxglove_shows_health_and_shapes(
    foxglove: dict[str, Any], samples: dict[str, Any]
) -> None:
    panels = foxglove["configById"]
    (health,) = (panel for name, panel in panels.items() if name.startswith("DiagnosticSummary!"))
    assert health["topicToRender"] in samples
    (scene,) = (panel for name, panel in panels.items() if name.startswith("3D!"))
    assert list(scene["topics"]) == [f"/{MARKERS_TOPIC.name}"]
    assert scene["followTf"] == INERTIAL
    (guidance,) = (p for name, p in panels.items() if name.startswith("DiagnosticStatusPanel!"))
    assert guidance["topicToRender"] == f"/{GUIDANCE_STATUS.name}"


def test_plotjuggler_plots_what_is_recorded(samples: dict[str, Any]) -> None:
    plotjuggler = ElementTree.parse(CONFIG / "plotjuggler_layout.xml").getroot()
    mirrored = {s.attrib["name"]: s.findtext("linked_source") for s in plotjuggler.iter("snippet")}
    curves = [curve.attrib["name"] for curve in plotjuggler.iter("curve")]
    assert set(mirrored) <= set(curves), "a computed series that nothing shows"
    topics = sorted(samples, key=len, reverse=True)
    for curve in curves:
        path = mirrored.get(curve, curve)
        assert path is not None
        topic = next((t for t in topics if path.startswith(f"{t}/")), path)
        assert_recorded(topic, path[len(topic) + 1 :].split("/"), samples)


def test_rviz_shows_the_markers_in_the_inertial_frame() -> None:
    rviz = yaml.safe_load((CONFIG / "ppc_attitude.rviz").read_text(encoding="utf-8"))
    manager = rviz["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == INERTIAL
    displays = {display["Class"].rpartition("/")[2]: display for display in manager["Displays"]}
    markers = displays["MarkerArray"]
    assert markers["Enabled"] is True
    assert markers["Topic"]["Value"] == f"/{MARKERS_TOPIC.name}"
    assert markers["Topic"]["Reliability Policy"] == "Reliable"  # what the node offers
    assert set(markers["Namespaces"]) == {
        *("craft", "body", "desired", "torque", "disturbance"),
        *("goal", "keep_out", "boresight"),
    }
    tools = {tool["Class"].rpartition("/")[2]: tool for tool in manager["Tools"]}
    assert tools["SetGoal"]["Topic"]["Value"] == f"/{GOAL_POSE.name}"
