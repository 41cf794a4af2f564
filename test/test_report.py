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
import json
import re
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from xml.etree import ElementTree

import numpy as np
import pytest
from conftest import nothing_drawn
from synthetic import hit_run, normal_run, with_columns, with_rows, without_columns

from ppc_attitude.analysis.figures import figures_of
from ppc_attitude.analysis.measure import Measured
from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.page import plotted, replay
from ppc_attitude.analysis.report import write_report
from ppc_attitude.command_line.verdict_view import verdict_table
from ppc_attitude.contract.run_record import Change

VOID = {"meta", "img", "input"}


class Page(HTMLParser):
    """What is on the page; fails on a tag that is not closed."""

    def __init__(self, text):
        super().__init__()
        self.open, self.words, self.attributes, self.tags, self.code = [], [], [], [], ""
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "script":
            self.code += data
        elif not self.open or self.open[-1] != "style":
            self.words.append(data)

    def all(self, attribute):
        """What every tag that has an attribute says there."""
        return [value for name, value in self.attributes if name == attribute]

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


def data_of(text):
    return json.loads(re.search(r"json\">(.*)</script>", text)[1])


def numbers_of(packed, width=1, form="<f4"):
    """Rows of numbers as the page carries them, shape (n, width)."""
    return np.frombuffer(base64.b64decode(packed), form).reshape(-1, width)


def report(tmp_path, *runs, **told):
    path = tmp_path / "sub" / "report.html"
    write_report([Verdict(run) for run in runs], path, **told)
    text = path.read_text(encoding="utf-8")
    return Page(text), text


@pytest.fixture(scope="module")
def one():
    return replace(hit_run(), warnings=("the clock jumped",), missing={"torque_command": 2})


@pytest.fixture(scope="module")
def page_of_one(one, tmp_path_factory):
    with nothing_drawn():
        return report(tmp_path_factory.mktemp("one"), one)


@pytest.fixture(scope="module")
def page_of_two(tmp_path_factory):
    other = replace(
        without_columns(normal_run(), "rate_envelope", "auxiliary_state"), controller="log_barrier"
    )
    other = with_columns(other, angular_velocity=0 * other["angular_velocity"] + 0.05)
    with nothing_drawn():
        return report(tmp_path_factory.mktemp("two"), normal_run(), other)


def test_one_run(one, page_of_one):
    run, (page, _) = one, page_of_one
    verdict = Verdict(run)
    for row in verdict.requirements:
        mark = {True: "✓ met", False: "✗ NOT MET", None: "– not judged"}[row.met]
        told = f"{row.name} {row.value_text} {row.limit_text} {row.span_text} {mark} {row.note}"
        assert told.strip() in page.text
    assert "ppc: 1 NOT MET, 2 not judged, 8 met of 11 requirements" in page.text
    assert page.all("alt") == [caption for caption, _ in figures_of(Measured(run)).values()]
    assert "the clock jumped" in page.text
    assert "missing of torque_command 2" in page.text
    assert "80 0.1 0.8, 0.8, 0.8 recovered after 3.41 s recovery" in page.text
    assert "20 0.1 0.8, 0.8, 0.8 recovered after" in page.text
    assert (
        "spacecraft_plant rate 100.0 Hz max_torque 0.05 N·m inertia [2.8, 0.0, 0.0, 0.0"
        in page.text
    )
    assert "Versions ppc_attitude 1.0.0 seed 1" in page.text
    assert "120 s in 12001 instants" in page.text


def test_one_name_means_one_number_and_says_over_which_part_it_is_taken(tmp_path, undrawn):
    run = hit_run()
    fast = np.deg2rad([0.0, 5.0, 0.0])
    page, _ = report(tmp_path, with_rows(run, "angular_velocity", 9000, fast))
    beside = "✓ met over the whole run 5 deg/s"
    assert f"angular rate (norm) 2.397 ≤ 3 deg/s 0 to 20 {beside}" in page.text
    outside = "outside its envelope 0 ≤ 0 s 0 to 20 ✓ met over the whole run 0.32 s"
    assert f"rate error {outside}" in page.text
    assert "(norm) before a sudden disturbance 2.397 deg/s 0 to 20" in page.text
    assert "(norm), whole run 5 deg/s 0 to 120" in page.text
    assert "settling time not settled 0 to 20" in page.text


def test_the_page_says_whose_it_is_and_hides_what_did_not_run(tmp_path, undrawn):
    law = {"controller": "log_barrier", "k": 3.0, "log_barrier.K1": 0.5, "inertia": [1.0]}
    run = replace(normal_run(5.0), parameters={"ppc_controller": law})
    page, _ = report(tmp_path, run, mission="Aeolus-3", date="2026-11-22 01:00")
    assert page.text.startswith("Aeolus-3: ppc Aeolus-3: ppc 2026-11-22 01:00")
    assert "log_barrier.K1 0.5" in page.text
    assert "inertia [1.0] kg·m²" in page.text
    assert "k 3.0" not in page.text  # of the law that did not run
    assert page.tags.count("details") == 3


def test_what_was_changed_in_flight_is_told(tmp_path, undrawn):
    run = normal_run(duration=2.0)  # of which one figure is drawn
    run = without_columns(run, *(run.columns.keys() - {"attitude_error", "angular_velocity"}))
    changes = (Change(1_500_000_000, "ppc_controller", "k", 4.0),)
    changed = replace(run, changes=changes)
    (_, text), verdict = report(tmp_path, changed), Verdict(changed)
    row = "<td>1.5</td><td>ppc_controller</td><td>k 3.0 → 4.0</td>"
    assert row in text
    since_1970 = 1_700_000_000_000_000_000
    (change,) = changes
    late = replace(
        changed,
        stamps_ns=run.stamps_ns + since_1970,
        changes=(change._replace(stamp_ns=change.stamp_ns + since_1970),),
    )
    assert row in report(tmp_path, late)[1]  # the time of the run, as everywhere in the page
    assert "<h3>Parameters changed in flight</h3>" not in report(tmp_path, run)[1]
    told = "parameters changed in flight: ppc_controller k 3.0 → 4.0 from 1.5 s on"
    assert verdict_table(verdict).splitlines()[-1] == told
    assert verdict.to_json()["changes"] == ["ppc_controller k 3.0 → 4.0 from 1.5 s on"]
    again = Change(1_600_000_000, "reference_generator", "enabled", True)
    told_again = ("reference_generator begins anew from 1.6 s on",)  # it was started again
    started = replace(run, changes=(again,))
    assert Verdict(started).changes == told_again
    assert "<td>reference_generator</td><td>begins anew</td>" in report(tmp_path, started)[1]
    many = Verdict(replace(run, changes=25 * changes))
    last = verdict_table(many).splitlines()[-1]
    assert last.endswith("from 1.5 s on; 5 more, all of them with --json")


def test_page_and_verdict_tell_one_start_and_torque_of_a_hit(tmp_path, undrawn):
    """What rounding leaves of the torque on the other axes is nothing."""
    run = normal_run(300.0)
    torque = run["disturbance_torque"] + [4e-4, -3e-4, 2e-4]
    hit = (run.t > 215.485) & (run.t < 215.585)
    torque[hit] += [0.1, -1.031e-17, 3.5e-16]
    changes = (Change(215_490_000_000, "ppc_controller", "k", 4.0),)
    run = replace(with_columns(run, disturbance_torque=torque), changes=changes)
    (page, _), verdict = report(tmp_path, run), verdict_table(Verdict(run))
    assert "215.49 0.1 0.1, 0, 0 recovered after" in page.text
    assert "sudden disturbance at 215.49 s, (0.1, 0, 0) N·m for 0.1 s" in verdict
    assert "3.0 → 4.0 from 215.49 s on" in verdict


def test_nothing_comes_from_outside(page_of_two):
    page, text = page_of_two
    assert not {"link", "iframe", "object"} & set(page.tags)
    assert all(each.startswith("data:image/svg+xml;base64,") for each in page.all("src"))
    assert page.all("href") == page.all("srcset") == []
    assert "@import" not in text
    assert "url(" not in text
    assert not re.search(r"fetch\(|XMLHttpRequest|WebSocket|import\(", page.code)


def test_the_page_is_the_same_each_time_and_every_image_a_whole_drawing(tmp_path):
    run = normal_run(5.0)
    quickly_drawn = {"attitude", "applied_torque"}
    run = without_columns(run, *(run.columns.keys() - quickly_drawn))
    page, text = report(tmp_path, run)
    assert text == report(tmp_path, run)[1]
    assert len(page.all("src")) == 2
    for image in page.all("src"):
        drawing = base64.b64decode(image.split(",")[1])
        root = ElementTree.fromstring(drawing)
        assert root.tag.endswith("svg")
        outside = re.findall(rb'xlink:href="([^#"][^"]*)"', drawing)
        assert outside == []


def test_figures_can_be_zoomed_on_the_numbers_of_the_drawing(page_of_one):
    """What a browser is given is what the figure's lines show."""
    figure = figures_of(Measured(normal_run(10.0)))["applied_torque"][1]
    (panel,) = data_of(plotted(figure))
    assert (panel["label"], panel["scale"]) == ("applied torque [N·m]", "linear")
    told = {line["label"]: line for line in panel["lines"] if line["label"]}
    assert list(told) == ["x", "y", "z", "limit ±0.05 N·m"]
    drawn = next(line for line in figure.axes[0].get_lines() if line.get_label() == "y")
    assert np.array_equal(numbers_of(told["y"]["x"], form="<f8")[:, 0], drawn.get_xdata())
    assert np.array_equal(numbers_of(told["y"]["y"])[:, 0], drawn.get_ydata().astype("<f4"))
    page, _ = page_of_one
    assert page.tags.count("figure") + 2 == page.tags.count("script")  # the replay, the program


def test_times_of_a_flight_of_months_stay_apart():
    """In four bytes the instants of a run that began three months ago were a second apart."""
    run = normal_run(10.0)
    begin = 8_000_000 * 10**9
    late = Measured(replace(run, stamps_ns=run.stamps_ns + begin))
    assert late.begin == 8e6
    (panel,) = data_of(plotted(figures_of(late)["applied_torque"][1]))
    for times in (panel["lines"][0]["x"], data_of(replay(late))["t"]):
        assert (np.diff(numbers_of(times, form="<f8")[:, 0]) > 0.009).all()


def test_a_chart_has_the_envelopes_by_name_the_limits_of_the_drawing_and_no_marks_of_hits():
    drawn = figures_of(Measured(hit_run()))
    told = [line["label"] for line in data_of(plotted(drawn["rate_error"][1]))[0]["lines"]]
    assert [each for each in told if "envelope" in each] == [f"envelope {k}" for k in "xyz"]
    whole, enlarged = data_of(plotted(drawn["disturbance"][1]))
    assert whole["limits"] is None
    assert enlarged["limits"] == list(drawn["disturbance"][1].axes[1].get_ylim())
    assert len(whole["lines"]) == len(enlarged["lines"]) == 3


@pytest.mark.filterwarnings("error")
def test_the_replay_shows_no_attitude_where_none_is_known():
    run = with_rows(normal_run(10.0), "attitude", (slice(3), 1), [np.nan, np.inf, 1e300])
    shown = numbers_of(data_of(replay(Measured(run)))["columns"]["attitude"], 4)
    assert not shown[:3].any()
    assert shown[3:].any(axis=1).all()


def test_the_replay_has_the_true_attitude_and_the_reference():
    run = normal_run(20.0)
    data = data_of(replay(Measured(run)))
    for name, column in (("attitude", "attitude"), ("reference", "reference_attitude")):
        rows = numbers_of(data["columns"][name], 4)
        assert np.array_equal(rows, run[column][::2].astype("<f4"))
    assert data["torque_limit"] == 0.05
    assert replay(Measured(without_columns(run, "attitude"))) == ""


def test_whatever_comes_from_the_record_is_escaped(tmp_path, undrawn):
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
    assert "alert(" not in page.code
    assert "b" not in page.tags
    assert page.text.count("alert(") >= 9
    assert nasty in unescape(text)


def test_several_runs_are_compared(page_of_two):
    page, _ = page_of_two
    text = page.text
    assert "ppc: 9 met of 9 requirements log_barrier: 1 NOT MET, 7 met of 8" in text
    assert "requirement ppc log_barrier limit" in text
    judged = "2.397 from 0 to 120 s ✓ met 4.962 from 0 to 120 s ✗ NOT MET"
    assert f"angular rate (norm) {judged} ≤ 3 deg/s" in text
    assert re.search(r"rate error outside its envelope 0 from 0 to 120 s ✓ met – ≤ 0 s", text)
    assert "comparison_rate_error is not drawn: simulate: the record has no sample of" in text
    captions = page.all("alt")
    assert captions[:2] == ["Pointing errors in the envelopes", "Angular velocities"]
    assert len(captions) == 2 + 8 + 6
    assert text.count("No sudden disturbance.") == 2


def test_a_comparison_tells_the_spans_and_no_number_where_none_is(tmp_path, undrawn):
    """A hit ends the span of the rate; a run that is too short is not judged."""
    told = {"attitude_error", "angular_velocity", "disturbance_torque"}
    runs = (
        without_columns(run, *(run.columns.keys() - told)) for run in (hit_run(), normal_run(30.0))
    )
    page, _ = report(tmp_path, *runs)
    assert "angular rate (norm) 2.397 from 0 to 20 s ✓ met 2.397 from 0 to 30 s ✓ met" in page.text
    assert "attitude error in the last 20 s – not judged – not judged < 0.0005" in page.text
