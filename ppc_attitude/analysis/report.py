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

from collections.abc import Sequence
from html import escape
from pathlib import Path

from ppc_attitude.analysis.comparison import comparisons_of, run_labels
from ppc_attitude.analysis.figures import figures_of
from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.page import (
    Html,
    asked,
    collapsed,
    configuration,
    figures,
    pairs,
    replay,
    table,
    write_page,
)
from ppc_attitude.analysis.series import AnalysisError, span_text
from ppc_attitude.analysis.truth import STANDING
from ppc_attitude.analysis.verdict import Requirement, number_text, torque_text
from ppc_attitude.science.stamps import instant

_METRICS = (
    ("settling_time_s", "settling time", "s"),
    ("error_after_settling_deadline", "largest |q_ev,i| after the deadline, no recoveries", ""),
    ("error_from_deadline_with_recoveries", "largest |q_ev,i| after the deadline", ""),
    ("terminal_error", "largest |q_ev,i| at the end", ""),
    ("max_rate_deg_s", "largest angular rate (norm) before a sudden disturbance", "deg/s"),
    ("max_rate_whole_run_deg_s", "largest angular rate (norm), whole run", "deg/s"),
    ("max_rate_axis_deg_s", "largest rate on an axis before a sudden disturbance", "deg/s"),
    ("max_rate_axis_whole_run_deg_s", "largest rate on an axis, whole run", "deg/s"),
    ("max_applied_torque", "largest applied torque on an axis", "N·m"),
    (
        "time_outside_attitude_envelope_s",
        "law's attitude error outside its envelope, whole run",
        "s",
    ),
    (
        "time_pointing_outside_attitude_envelope_s",
        "true attitude error outside that envelope, whole run",
        "s",
    ),
    ("time_outside_rate_envelope_s", "law's rate error outside its envelope, whole run", "s"),
)


def write_report(runs: Sequence[Verdict], path: Path, *, mission: str = "", date: str = "") -> None:
    """Write the report of one to six runs; several are compared in a table and common figures.

    It is an HTML file, as of `write_page`; the mission is for its title, the date when it is made.

    Raises
    ------
    AnalysisError
        If a run has nothing to draw.
    """
    labels = run_labels([run.record for run in runs])
    title = f"{mission or 'Attitude control report'}: {', '.join(labels)}"
    body = [_heading(runs, labels)]
    if len(runs) > 1:
        body.append(_comparison(runs, labels))
    for run, label in zip(runs, labels, strict=True):
        body.append(_run_section(run, label if len(runs) > 1 else "Run"))
    write_page(path, title, date, body)


def _heading(runs: Sequence[Verdict], labels: Sequence[str]) -> str:
    """Say in one line for each run how it came out."""
    lines = []
    for verdict, label in zip(runs, labels, strict=True):
        style = "met" if verdict.all_met else "failed"
        lines.append(f'<p class="{style}">{escape(f"{label}: {verdict.summary}")}</p>')
    return "\n".join(lines)


def _comparison(runs: Sequence[Verdict], labels: Sequence[str]) -> str:
    """Put the requirements of all runs in one table, then the common figures."""
    names = list(dict.fromkeys(each.name for run in runs for each in run.requirements))
    rows = []
    for name in names:
        found = [next((r for r in run.requirements if r.name == name), None) for run in runs]
        limits = dict.fromkeys(each.limit_text for each in found if each)
        told = [_compared(each) if each else "–" for each in found]
        rows.append([name, *told, ", ".join(limits)])
    numbers = [(label, "number") for label in labels]
    compared = table([("requirement", "name"), *numbers, ("limit", "")], rows)
    try:
        common, lacking = comparisons_of(runs)
        drawn = figures(common.values(), "page")
    except AnalysisError as error:  # runs of which each lacks what the other has
        drawn, lacking = "", [str(error)]
    not_drawn = "".join(f"<p>{escape(each)}</p>\n" for each in lacking)
    return f"<h2>Comparison</h2>\n{compared}{drawn}{not_drawn}"


def _run_section(verdict: Verdict, title: str) -> str:
    """Everything about one run."""
    record = verdict.record
    facts = [
        ("source", record.source),
        ("controller", record.controller),
        ("duration", f"{instant(verdict.duration_s)} s in {verdict.t.size} instants"),
        ("truth", STANDING[verdict.truth.standing]),
        ("missing messages", str(record.missing_messages)),
    ]
    facts += [(f"missing of {topic}", str(count)) for topic, count in record.missing.items()]
    warnings = "".join(f'<p class="warning">{escape(each)}</p>\n' for each in record.warnings)
    drawn = figures_of(verdict).values()
    return "\n".join(
        [
            f'<section class="run"><h2>{escape(title)}</h2>',
            warnings + pairs(facts),
            "<h3>Requirements</h3>",
            _requirements(verdict),
            _disturbances(verdict),
            _faults(verdict),
            _changes(verdict),
            "<h3>Attitude errors</h3>",
            _errors(verdict),
            "<h3>Other numbers</h3>",
            _metrics(verdict),
            "<h3>Figures</h3>",
            figures(drawn, "column"),
            "<h3>Replay</h3>",
            replay(verdict),
            asked(verdict.required),
            collapsed("Configuration, as the run began", configuration(record.parameters)),
            collapsed("Versions", pairs(record.metadata.items())),
            "</section>",
        ]
    )


def _requirements(verdict: Verdict) -> str:
    rows = [
        (each.name, each.value_text, each.limit_text, each.span_text, _outcome(each), each.note)
        for each in verdict.requirements
    ]
    told = [(title, "") for title in ("judged [s]", "verdict", "note")]
    return table([("requirement", "name"), ("value", "number"), ("limit", "text"), *told], rows)


def _compared(each: Requirement) -> Html:
    """Tell the number, where there is one, over which part of the run it is taken, and verdict."""
    number = "" if each.value is None else f"{each.value_text} from {each.span_text} s "
    return Html(f"{number}{_outcome(each)}")


def _outcome(each: Requirement) -> Html:
    """Tell the verdict in words as well as in colour."""
    style, mark = {None: ("open", "–"), True: ("met", "✓"), False: ("failed", "✗")}[each.met]
    return Html(f'<span class="{style}">{mark} {each.outcome}</span>')


def _errors(verdict: Verdict) -> str:
    """The three errors, never mixed."""
    rows = []
    for each in verdict.errors:
        sizes = (each.max_deg, each.rms_deg)
        told = ("not known" if size is None else number_text(size) for size in sizes)
        rows.append([f"{each.name}: {each.meaning}", *told, each.span_text])
    numbers = [(title, "number") for title in ("largest [deg]", "RMS [deg]")]
    return table([("error", "name"), *numbers, ("over [s]", "")], rows)


def _metrics(verdict: Verdict) -> str:
    rows = []
    metrics = verdict.metrics
    for field, name, unit in _METRICS:
        value, span = getattr(metrics, field), metrics.spans.get(field)
        text = "–" if value is None else f"{number_text(value)} {unit}".rstrip()
        if field == "settling_time_s" and metrics.settled is False:
            text = "not settled"
        rows.append((name, text, span_text(span)))
    return table([("number", "name"), ("value", "number"), ("over [s]", "")], rows)


def _changes(verdict: Verdict) -> str:
    """Parameters changed in flight: each with its time, its node, and both values."""
    rows = [*verdict.change_rows]
    if not rows:
        return ""
    head = [(title, "") for title in ("from [s]", "node", "parameter, old → new")]
    return "<h3>Parameters changed in flight</h3>\n" + table(head, rows)


def _faults(verdict: Verdict) -> str:
    if not verdict.faults:
        return ""
    told = "".join(f"<li>{escape(each)}</li>" for each in verdict.faults)
    return f"<h3>Faults</h3>\n<ul>{told}</ul>"


def _disturbances(verdict: Verdict) -> str:
    if not verdict.metrics.disturbances:
        return "<p>No sudden disturbance.</p>"
    rows = [
        (instant(hit.start_s), f"{hit.duration_s:g}", torque_text(hit), hit.outcome, hit.judged_by)
        for hit in verdict.metrics.disturbances
    ]
    titles = ("start [s]", "duration [s]", "torque x, y, z [N·m]", "recovery", "judged by")
    return "<h3>Sudden disturbances</h3>\n" + table([(title, "") for title in titles], rows)
