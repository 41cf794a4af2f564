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

"""What is told of faults of the hardware: by verdict, report, figures, certificate and `check`."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Ask
from craft_helpers import case, configs, overlay
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from synthetic import normal_run, requirement, with_parameters, with_rows
from test_hardware_faults import WORDS

from ppc_attitude.analysis.comparison import comparisons_of
from ppc_attitude.analysis.drawing import RED
from ppc_attitude.analysis.envelopes import ENVELOPES
from ppc_attitude.analysis.faults import faults_of
from ppc_attitude.analysis.figures import error_figure
from ppc_attitude.analysis.guarantee import certificate_held
from ppc_attitude.analysis.measure import Measured
from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.page import plotted
from ppc_attitude.analysis.report import write_report
from ppc_attitude.command_line.verdict_view import verdict_table
from ppc_attitude.contract.run_record import Change, RunRecord
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.simulation.closed_loop import simulate


def failed(at_start: Any, *changes: tuple[float, Any]) -> RunRecord:
    """Run of 10 s whose plant was given faults, some of them in flight [s]."""
    run = normal_run(duration=10.0)
    told = tuple(Change(round(t * 1e9), PLANT, "faults", texts) for t, texts in changes)
    return replace(with_parameters(run, PLANT, {"faults": at_start}), changes=told)


STUCK, WEAK = "actuator/x stuck 0.01", "actuator/y effectiveness 0.5"


@pytest.mark.parametrize(
    ("record", "expected"),
    [
        (failed([""]), ()),
        (failed([]), ()),
        (failed([f"{STUCK} from 2 for 3", WEAK]), (f"{WEAK}, 0 to 10 s", f"{STUCK}, 2 to 5 s")),
        # One that ends after the run, or begins after it.
        (failed([f"{STUCK} from 8 for 5", f"{WEAK} from 11"]), (f"{STUCK}, 8 to 10 s",)),
        # In flight: what is in both lists goes on, what is in the new one alone begins with it.
        (
            failed([STUCK], (4.0, [f"{STUCK} from 1", WEAK])),
            (f"{STUCK}, 0 to 10 s", f"{WEAK}, 4 to 10 s"),
        ),
        (
            failed([STUCK], (4.0, [""]), (6.0, [STUCK])),
            (f"{STUCK}, 0 to 4 s", f"{STUCK}, 6 to 10 s"),
        ),
        (failed([""], (4.0, [f"{STUCK} for 2"])), ()),
        # Of one kind of one part the last one acts, while it does.
        (
            failed([STUCK, "actuator/x stuck 0.02 from 3 for 2", "actuator/x bias 1 from 3 for 2"]),
            (
                f"{STUCK}, 0 to 3 s",
                "actuator/x stuck 0.02, 3 to 5 s",
                "actuator/x bias 1, 3 to 5 s",
                f"{STUCK}, 5 to 10 s",
            ),
        ),
        (
            failed([f"{STUCK} for 2", f"{STUCK} from 2 for 2", f"{STUCK} from 3"]),
            (f"{STUCK}, 0 to 10 s",),
        ),
        # What a bag of somebody else's may hold.
        (failed([STUCK], (-1.0, [WEAK]), (12.0, [STUCK])), (f"{WEAK}, 0 to 10 s",)),
        (failed("everything"), ()),
        (
            failed([3.0, None, "\x1b[2J", "wheel/0", "a b from x", f"{STUCK} from 1"]),
            (f"{STUCK}, 1 to 10 s",),
        ),
    ],
)
def test_what_acted_is_told_from_when_to_when(record: RunRecord, expected: tuple[str, ...]) -> None:
    assert tuple(map(str, faults_of(record))) == expected
    verdict = Verdict(record)
    assert verdict.faults == expected
    assert verdict.to_json()["faults"] == list(expected)
    lines = [line for line in verdict_table(verdict).splitlines() if line.startswith("fault: ")]
    assert lines == [f"fault: {each}" for each in expected]


@settings(max_examples=40)
@given(st.lists(st.lists(WORDS, max_size=6).map(" ".join), max_size=20))
def test_any_texts_of_a_bag_are_told_or_left_out(texts: list[str]) -> None:
    record = replace(SHORT, parameters={PLANT: {"faults": texts}})
    for each in faults_of(record):
        assert 0.0 <= each.start_s < each.end_s <= 1.0
        assert str(each).isprintable()


SHORT = normal_run(duration=1.0)


def ends_of(axes: Axes) -> list[float]:
    """Where the bands of a figure begin and end [s]."""
    bands = [patch.get_extents().transformed(axes.transData.inverted()) for patch in axes.patches]
    return [end for band in bands for end in (band.x0, band.x1)]


@pytest.mark.usefixtures("undrawn")
def test_a_report_lists_faults_and_figures_show_them(tmp_path: Path) -> None:
    record = failed([f"{STUCK} from 2 for 3"], (7.0, [f"{WEAK} from 7"]))
    page = tmp_path / "report.html"
    write_report([Verdict(record)], page)
    text = page.read_text(encoding="utf-8")
    assert f"<h3>Faults</h3>\n<ul><li>{STUCK}, 2 to 5 s</li><li>{WEAK}, 7 to 10 s</li></ul>" in text
    figure = error_figure(Measured(record), ENVELOPES[0])
    axes = figure.axes[0]
    assert ends_of(axes) == pytest.approx([2.0, 5.0, 7.0, 10.0])
    for panel in json.loads(plotted(figure).partition(">")[2].rpartition("<")[0]):
        ends = [end for band in panel["bands"] for end in (band["from"], band["to"])]
        assert ends == pytest.approx([2.0, 5.0, 7.0, 10.0])
        assert {band["colour"] for band in panel["bands"]} == {to_hex(RED) + "14"}
    assert "fault" in axes.get_legend_handles_labels()[1]
    whole = failed([""])
    write_report([Verdict(whole)], page)
    assert "Faults" not in page.read_text(encoding="utf-8")
    assert not error_figure(Measured(whole), ENVELOPES[0]).axes[0].patches


def test_a_comparison_shows_the_faults_of_every_run_each_once() -> None:
    runs = [failed([f"{STUCK} from 2 for 3"]), failed([f"{STUCK} from 2 for 3", f"{WEAK} from 7"])]
    for _, figure in comparisons_of(list(map(Measured, runs)))[0].values():
        assert ends_of(figure.axes[0]) == pytest.approx([2.0, 5.0, 7.0, 10.0])
        assert "fault" in figure.axes[0].get_legend_handles_labels()[1]


def test_an_envelope_is_not_judged_while_the_law_is_told_no_attitude() -> None:
    """It then holds the error that it knew last, which stays inside whatever the craft does."""
    given = {"faults": ["gyro dead from 1 for 0.5", "gyro dead from 2.5"], "duration": 3.0}
    record = simulate(case("sensors_smallsat", **given), 3.0)
    known = record["attitude"].any(axis=1)
    back = record.t[150:][known[150:]][0]
    verdict = Verdict(with_rows(record, "rate_error", slice(50, 70), np.nan))
    gaps = {"outside_attitude_envelope": (), "outside_rate_envelope": ((0.49, 0.7),)}
    for key, gap in gaps.items():
        row = requirement(verdict, key)
        assert row.without == (*gap, (1.0, back), (2.5, 3.0))
        assert row.note.endswith(f"1 to {back:g}, 2.5 to 3")
    assert requirement(verdict, "rate").without == ()
    lost = simulate(case("sensors_smallsat", faults=["gyro dead"]), 1.0)
    row = requirement(Verdict(lost), "outside_attitude_envelope")
    assert (row.met, row.note) == (None, "the law was told no attitude from 0 to 1 s")


@pytest.mark.parametrize("in_flight", [False, True])
def test_no_certificate_covers_a_fault(in_flight: bool) -> None:
    record = simulate(case("guaranteed", faults=[""] if in_flight else [STUCK]), 2.0)
    if in_flight:
        record = replace(record, changes=(Change(10**9, PLANT, "faults", [STUCK]),))
    held = certificate_held(record)
    assert held is not None
    assert STUCK in held.reason
    assert not held.outside.any()


@pytest.mark.usefixtures("coarse")
def test_check_lists_faults_and_says_that_a_certificate_is_void(tmp_path: Path, ask: Ask) -> None:
    file = overlay(tmp_path / "faults.yaml", {PLANT: {"faults": [STUCK, WEAK]}})
    assert f"fault: {STUCK}\nfault: {WEAK}\n" in ask("check", "--config", file).out
    assert ask("check", "--config", file, "--json").json["faults"] == [STUCK, WEAK]
    law = tmp_path / "law.yaml"  # without its certificate, whose every time would be proved
    law.write_text(configs("guaranteed")[0].read_text())
    guaranteed = [f"--config={each}" for each in (*configs("paper"), law, file)]
    told = ask("check", *guaranteed, code=1).page
    assert f"faults = '{STUCK}': whether it keeps the assumed bounds" in told
    overlay(file, {PLANT: {"faults": ["wheel/7 seized"]}})
    refused = ask("check", "--config", file, code=2).err
    assert "'wheel/7 seized': no selected component has a part wheel/7" in refused


def test_nothing_is_designed_for_hardware_that_fails(tmp_path: Path, ask: Ask) -> None:
    options = [f"--config={file}" for file in configs("paper", "orbit", "faults")]
    refused = ask("design", *options, "--output", tmp_path / "gains.yaml", code=2).err
    told = "faults: 'wheel/2 effectiveness 0.0 from 40.0': nothing can be guaranteed of it"
    assert told in refused
    assert not [*tmp_path.iterdir()]
