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
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from rosbags.highlevel import AnyReader
from test_layers import ROOT

from ppc_attitude.contract.topics import BY_NAME, INERTIAL, MARKERS_TOPIC
from ppc_attitude.nodes.messages import message_class

CONFIG = ROOT / "config"
AXES = "xyz"
ENVELOPES = {
    f"/control/{kind}_error/{field}/{axis}": f"/control/{kind}_envelope/vector/{axis}"
    for kind, field in (("attitude", "quaternion"), ("rate", "vector"))
    for axis in AXES
}


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


@pytest.fixture(scope="module")
def plotjuggler() -> ElementTree.Element:
    return ElementTree.parse(CONFIG / "plotjuggler_layout.xml").getroot()


@pytest.fixture(scope="module")
def rviz() -> dict[str, Any]:
    return dict(yaml.safe_load((CONFIG / "ppc_attitude.rviz").read_text(encoding="utf-8")))


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


def foxglove_paths(layout: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Panel, path and modifier of every plotted series."""
    for name, panel in layout["configById"].items():
        for series in panel.get("paths", []):
            path, _, modifier = series["value"].partition(".@")
            yield name, path, modifier


def leaves(layout: Any) -> list[str]:
    if isinstance(layout, str):
        return [layout]
    assert layout["direction"] in ("row", "column")
    assert 0.0 < layout["splitPercentage"] < 100.0
    return [*leaves(layout["first"]), *leaves(layout["second"])]


def test_foxglove_plots_what_is_recorded(foxglove: dict[str, Any], samples: dict[str, Any]) -> None:
    paths = list(foxglove_paths(foxglove))
    assert paths
    for _, path, modifier in paths:
        topic, *fields = path.split(".")
        assert_recorded(topic, fields, samples)
        assert modifier in ("", "negative")


def test_foxglove_shows_every_error_inside_its_envelope(foxglove: dict[str, Any]) -> None:
    shown: dict[str, set[tuple[str, str]]] = {}
    for panel, path, modifier in foxglove_paths(foxglove):
        shown.setdefault(panel, set()).add((path.replace(".", "/"), modifier))
    for error, envelope in ENVELOPES.items():
        wanted = {(error, ""), (envelope, ""), (envelope, "negative")}
        assert any(wanted == series for series in shown.values()), error


def test_foxglove_places_every_panel_once(foxglove: dict[str, Any]) -> None:
    assert sorted(leaves(foxglove["layout"])) == sorted(foxglove["configById"])


def test_foxglove_shows_health_and_shapes(
    foxglove: dict[str, Any], samples: dict[str, Any]
) -> None:
    panels = foxglove["configById"]
    (health,) = (panel for name, panel in panels.items() if name.startswith("DiagnosticSummary!"))
    assert health["topicToRender"] in samples
    (scene,) = (panel for name, panel in panels.items() if name.startswith("3D!"))
    assert list(scene["topics"]) == [f"/{MARKERS_TOPIC.name}"]
    assert scene["followTf"] == INERTIAL


def test_plotjuggler_plots_what_is_recorded(
    plotjuggler: ElementTree.Element, samples: dict[str, Any]
) -> None:
    mirrored = {s.attrib["name"]: s.findtext("linked_source") for s in plotjuggler.iter("snippet")}
    curves = [curve.attrib["name"] for curve in plotjuggler.iter("curve")]
    assert set(mirrored) <= set(curves), "a computed series that nothing shows"
    topics = sorted(samples, key=len, reverse=True)
    for curve in curves:
        path = mirrored.get(curve, curve)
        assert path is not None
        topic = next((t for t in topics if path.startswith(f"{t}/")), path)
        assert_recorded(topic, path[len(topic) + 1 :].split("/"), samples)


def test_plotjuggler_shows_every_error_inside_its_envelope(
    plotjuggler: ElementTree.Element,
) -> None:
    mirrored = {}
    for snippet in plotjuggler.iter("snippet"):
        assert snippet.findtext("function") == "return -value"
        mirrored[snippet.attrib["name"]] = f"-{snippet.findtext('linked_source')}"
    plots = [
        {mirrored.get(c.attrib["name"], c.attrib["name"]) for c in plot.iter("curve")}
        for plot in plotjuggler.iter("plot")
    ]
    for error, envelope in ENVELOPES.items():
        assert {error, envelope, f"-{envelope}"} in plots, error


def test_plotjuggler_splits_as_it_says(plotjuggler: ElementTree.Element) -> None:
    for splitter in plotjuggler.iter("DockSplitter"):
        sizes = [float(size) for size in splitter.attrib["sizes"].split(";")]
        assert len(sizes) == int(splitter.attrib["count"]) == len(list(splitter))
        assert sum(sizes) == pytest.approx(1.0, abs=1e-5)


def test_colours_are_colours(foxglove: dict[str, Any], plotjuggler: ElementTree.Element) -> None:
    colours = {curve.attrib["color"] for curve in plotjuggler.iter("curve")} | {
        series["color"]
        for panel in foxglove["configById"].values()
        for series in panel.get("paths", [])
    }
    assert all(re.fullmatch("#[0-9A-Fa-f]{6}", colour) for colour in colours)


def test_rviz_shows_the_markers_in_the_inertial_frame(rviz: dict[str, Any]) -> None:
    manager = rviz["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == INERTIAL
    displays = {display["Class"].rpartition("/")[2]: display for display in manager["Displays"]}
    markers = displays["MarkerArray"]
    assert markers["Enabled"] is True
    assert markers["Topic"]["Value"] == f"/{MARKERS_TOPIC.name}"
    assert markers["Topic"]["Reliability Policy"] == "Reliable"  # what the node offers
    assert set(markers["Namespaces"]) == {"craft", "body", "desired", "torque", "disturbance"}
