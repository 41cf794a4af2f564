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

"""The page: complete, self-contained, escaped."""

import base64
import re
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from xml.etree import ElementTree

import pytest
from synthetic import hit_run, normal_run, with_columns, without_columns

from ppc_attitude.analysis.figures import FIGURES
from ppc_attitude.analysis.metrics import analyse
from ppc_attitude.analysis.report import run_labels, write_report
from ppc_attitude.analysis.series import AnalysisError

VOID = {"meta", "img"}


class Page(HTMLParser):
    """What is on the page; fails on a tag that is not closed."""

    def __init__(self, text):
        super().__init__()
        self.open, self.words, self.images, self.attributes, self.tags = [], [], [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs
        if tag == "img":
            self.images.append(dict(attrs))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if not self.open or self.open[-1] != "style":
            self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


def report(tmp_path, *runs):
    path = tmp_path / "sub" / "report.html"
    write_report([(run, analyse(run)) for run in runs], path)
    text = path.read_text(encoding="utf-8")
    return Page(text), text


def test_one_run(tmp_path):
    run = replace(hit_run(), warnings=("the clock jumped",), missing={"torque_command": 2})
    page, _ = report(tmp_path, run)
    verdict = analyse(run)
    for row in verdict.requirements:
        outcome = "✓ met" if row.met else "✗ failed"
        assert f"{row.name} {row.value_text} {row.limit_text} {outcome}" in page.text
    assert f"1 of {len(verdict.requirements)} requirements failed" in page.text
    assert [image["alt"] for image in page.images] == [caption for caption, _ in FIGURES.values()]
    assert "the clock jumped" in page.text
    assert "missing of torque_command 2" in page.text
    assert "80 0.1 0.8, 0.8, 0.8 3.41" in page.text
    assert "spacecraft_plant rate 100.0 max_torque 0.05 inertia [2.8, 0, 0, 0, 2.5]" in page.text
    assert "Versions ppc_attitude 1.0.0 seed 1" in page.text
    assert "120 s in 12001 instants" in page.text


def test_a_good_run(tmp_path):
    page, _ = report(tmp_path, normal_run())
    assert "All requirements met" in page.text
    assert "✗" not in page.text
    assert "No sudden disturbance." in page.text


def test_nothing_comes_from_outside(tmp_path):
    page, text = report(tmp_path, normal_run(30.0), hit_run(30.0))
    assert not {"script", "link", "iframe", "object"} & set(page.tags)
    assert all(image["src"].startswith("data:image/svg+xml;base64,") for image in page.images)
    assert [name for name, _ in page.attributes if name in ("href", "srcset")] == []
    assert "@import" not in text
    assert "url(" not in text


def test_every_image_is_a_whole_drawing(tmp_path):
    page, _ = report(tmp_path, normal_run(10.0))
    for image in page.images:
        drawing = base64.b64decode(image["src"].split(",")[1])
        root = ElementTree.fromstring(drawing)
        assert root.tag.endswith("svg")
        outside = re.findall(rb'xlink:href="([^#"][^"]*)"', drawing)
        assert outside == []


def test_whatever_comes_from_the_record_is_escaped(tmp_path):
    nasty = '<script>alert("x")</script> & <b>'
    run = replace(
        normal_run(5.0),
        source=nasty,
        controller=nasty,
        parameters={nasty: {nasty: nasty, "list": [nasty]}},
        metadata={nasty: nasty},
        warnings=(nasty,),
        missing={nasty: 1},
    )
    page, text = report(tmp_path, run)
    assert "script" not in page.tags
    assert "b" not in page.tags
    assert "<script" not in text
    assert page.text.count("alert(") >= 9
    assert nasty in unescape(text)


def test_several_runs_are_compared(tmp_path):
    other = replace(
        without_columns(normal_run(), "rate_envelope", "auxiliary_state"),
        controller="log_barrier",
    )
    other = with_columns(other, angular_velocity=0 * other["angular_velocity"] + 0.05)
    page, _ = report(tmp_path, normal_run(), other)
    text = page.text
    assert "requirement ppc log_barrier limit" in text
    assert "angular rate (norm) 2.397 ✓ met 4.962 ✗ failed ≤ 3 deg/s" in text
    assert re.search(r"rate error outside its envelope 0 ✓ met – ≤ 0 s", text)
    captions = [image["alt"] for image in page.images]
    assert captions[:2] == ["Attitude errors in their envelopes", "Angular velocities"]
    assert len(captions) == 2 + 7 + 6


def test_the_page_is_the_same_each_time(tmp_path):
    run = normal_run(5.0)
    write_report([(run, analyse(run))], tmp_path / "a.html")
    write_report([(run, analyse(run))], tmp_path / "b.html")
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


def test_no_run():
    with pytest.raises(AnalysisError, match="no run"):
        write_report([], None)


@pytest.mark.parametrize(
    ("controllers", "sources", "labels"),
    [
        (["ppc", "log_barrier"], ["a", "b"], ["ppc", "log_barrier"]),
        (["ppc", "ppc"], ["x/a", "x/b"], ["a", "b"]),
        (["ppc", "ppc"], ["x/a", "y/a"], ["a (1)", "a (2)"]),
    ],
)
def test_labels(controllers, sources, labels):
    run = normal_run(0.0)
    runs = [replace(run, controller=c, source=s) for c, s in zip(controllers, sources, strict=True)]
    assert run_labels(runs) == labels
