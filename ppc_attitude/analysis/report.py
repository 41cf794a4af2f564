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

"""One self-contained HTML page: verdicts, figures, configuration and versions of the runs."""

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from ppc_attitude.analysis.comparison import COMPARISONS, comparisons_of
from ppc_attitude.analysis.figures import FIGURES, figures_of
from ppc_attitude.analysis.page import configuration, figures, pairs, table, write_page
from ppc_attitude.analysis.series import AnalysisError
from ppc_attitude.analysis.verdict import Metrics, Requirement, Verdict, number_text
from ppc_attitude.contract.run_record import RunRecord

_METRICS = (
    ("settling_time_s", "settling time", "s"),
    ("error_after_settling_deadline", "largest attitude error from 60 s on", ""),
    ("terminal_error", "largest attitude error in the last 20 s", ""),
    ("max_rate_deg_s", "largest angular rate (norm)", "deg/s"),
    ("max_rate_axis_deg_s", "largest angular rate on an axis", "deg/s"),
    ("max_applied_torque", "largest applied torque on an axis", "N·m"),
    ("time_outside_attitude_envelope_s", "attitude error outside its envelope", "s"),
    ("time_outside_rate_envelope_s", "rate error outside its envelope", "s"),
)


def write_report(runs: Sequence[tuple[RunRecord, Verdict]], path: Path) -> None:
    """Write the report of one run, or of several side by side.

    Parameters
    ----------
    runs : sequence of (RunRecord, Verdict)
        Each run with its judgement; several are compared in one table and in common figures.
    path : Path
        The HTML file; its folder is made if there is none, the file is replaced if there is one.

    Raises
    ------
    AnalysisError
        If there is no run, or more than can be told apart in a figure, or nothing to draw.
    """
    if not runs:
        raise AnalysisError("no run to report on")
    labels = run_labels([record for record, _ in runs])
    body = [_heading(runs)]
    if len(runs) > 1:
        body.append(_comparison(runs, labels))
    for (record, verdict), label in zip(runs, labels, strict=True):
        body.append(_run_section(record, verdict, label if len(runs) > 1 else "Run"))
    write_page(path, _title(runs), body)


def run_labels(records: Sequence[RunRecord]) -> list[str]:
    """Name each run as shortly as tells it from the others.

    Parameters
    ----------
    records : sequence of RunRecord
        The runs.

    Returns
    -------
    list of str
        The controllers if they differ; else the names of the bags; else these with numbers.
    """
    controllers = [record.controller for record in records]
    bags = [Path(record.source).name or record.source for record in records]
    for names in (controllers, bags):
        if len(set(names)) == len(names):
            return names
    return [f"{name} ({k})" for k, name in enumerate(bags, start=1)]


def _title(runs: Sequence[tuple[RunRecord, Verdict]]) -> str:
    names = ", ".join(verdict.controller for _, verdict in runs)
    return f"Attitude control report: {names}"


def _heading(runs: Sequence[tuple[RunRecord, Verdict]]) -> str:
    """Say in one line how it came out."""
    failed = sum(not each.met for _, verdict in runs for each in verdict.requirements)
    judged = sum(len(verdict.requirements) for _, verdict in runs)
    outcome = "All requirements met" if failed == 0 else f"{failed} of {judged} requirements failed"
    return (
        f'<h1>{escape(_title(runs))}</h1>\n<p class="{"failed" if failed else "met"}">{outcome}</p>'
    )


def _comparison(runs: Sequence[tuple[RunRecord, Verdict]], labels: Sequence[str]) -> str:
    """Put the requirements of all runs in one table, then the common figures."""
    names = list(dict.fromkeys(each.name for _, v in runs for each in v.requirements))
    rows = []
    for name in names:
        found = [_requirement(verdict, name) for _, verdict in runs]
        limits = dict.fromkeys(each.limit_text for each in found if each is not None)
        cells = "".join(
            '<td class="number">–</td>' if each is None else _value_cell(each) for each in found
        )
        rows.append(f"<tr><th>{escape(name)}</th>{cells}<td>{escape(', '.join(limits))}</td></tr>")
    records = [record for record, _ in runs]
    return (
        "<h2>Comparison</h2>\n"
        + table(["requirement", *labels, "limit"], rows)
        + figures(_captioned(comparisons_of(records, labels), COMPARISONS), "page")
    )


def _captioned(
    drawn: Mapping[str, Figure], known: Mapping[str, tuple[str, Any]]
) -> dict[str, Figure]:
    """Figures by the captions of the table that made them."""
    return {known[name][0]: figure for name, figure in drawn.items()}


def _requirement(verdict: Verdict, name: str) -> Requirement | None:
    return next((each for each in verdict.requirements if each.name == name), None)


def _value_cell(each: Requirement) -> str:
    return f'<td class="number">{escape(each.value_text)} {_outcome(each)}</td>'


def _run_section(record: RunRecord, verdict: Verdict, title: str) -> str:
    """Everything about one run."""
    facts = [
        ("source", verdict.source),
        ("controller", verdict.controller),
        ("duration", f"{verdict.duration_s:g} s in {verdict.steps} instants"),
        ("missing messages", str(verdict.missing_messages)),
    ]
    facts += [(f"missing of {topic}", str(count)) for topic, count in record.missing.items()]
    warnings = "".join(f'<p class="warning">{escape(each)}</p>\n' for each in record.warnings)
    return "\n".join(
        [
            f'<section class="run"><h2>{escape(title)}</h2>',
            warnings + pairs(facts),
            "<h3>Requirements</h3>",
            _requirements(verdict),
            "<h3>Metrics</h3>",
            _metrics(verdict.metrics),
            _disturbances(verdict.metrics),
            "<h3>Figures</h3>",
            figures(_captioned(figures_of(record), FIGURES), "column"),
            "<h3>Configuration</h3>",
            configuration(record.parameters),
            "<h3>Versions</h3>",
            pairs(record.metadata.items()) if record.metadata else "<p>not recorded</p>",
            "</section>",
        ]
    )


def _requirements(verdict: Verdict) -> str:
    rows = [
        f'<tr><th>{escape(each.name)}</th><td class="number">{escape(each.value_text)}</td>'
        f"<td>{escape(each.limit_text)}</td><td>{_outcome(each)}</td></tr>"
        for each in verdict.requirements
    ]
    return table(["requirement", "value", "limit", "verdict"], rows)


def _outcome(each: Requirement) -> str:
    """Tell the verdict in words as well as in colour."""
    return '<span class="met">✓ met</span>' if each.met else '<span class="failed">✗ failed</span>'


def _metrics(metrics: Metrics) -> str:
    rows = []
    for field, name, unit in _METRICS:
        value = getattr(metrics, field)
        text = "–" if value is None else f"{number_text(value)} {unit}".rstrip()
        rows.append(f'<tr><th>{escape(name)}</th><td class="number">{escape(text)}</td></tr>')
    return table(["metric", "value"], rows)


def _disturbances(metrics: Metrics) -> str:
    if not metrics.disturbances:
        return "<p>No sudden disturbance.</p>"
    rows = []
    for hit in metrics.disturbances:
        recovery = hit.recovery_time_s
        cells = [
            number_text(hit.start_s),
            number_text(hit.duration_s),
            ", ".join(number_text(each) for each in hit.torque),
            "not recovered" if recovery is None else number_text(recovery),
        ]
        rows.append(
            "<tr>" + "".join(f'<td class="number">{escape(cell)}</td>' for cell in cells) + "</tr>"
        )
    head = ["start [s]", "duration [s]", "torque x, y, z [N·m]", "recovery [s]"]
    return "<h3>Sudden disturbances</h3>\n" + table(head, rows)
