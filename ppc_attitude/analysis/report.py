"""One self-contained HTML page: verdicts, figures, configuration and versions of the runs."""

import base64
import io
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from ppc_attitude.analysis.comparison import COMPARISONS, comparisons_of
from ppc_attitude.analysis.figures import FIGURES, figures_of
from ppc_attitude.analysis.series import AnalysisError
from ppc_attitude.analysis.verdict import Metrics, Requirement, Verdict, number_text
from ppc_attitude.contract.run_record import RunRecord

# Colours are stated throughout and the scheme is light: a dark browser changes nothing.
_CSS = """
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1.5rem; max-width: 64rem; background: #fff; color: #1a1a1a;
  font: 15px/1.45 system-ui, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.5rem; margin: 0 0 .3rem; }
h2 { font-size: 1.2rem; margin: 2.2rem 0 .5rem; border-bottom: 2px solid #0072b2; }
h3 { font-size: 1rem; margin: 1.4rem 0 .4rem; }
p { margin: .4rem 0; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .9rem; background: #fff; color: #1a1a1a; }
th, td { text-align: left; padding: .25rem .7rem; border-bottom: 1px solid #ddd;
  vertical-align: top; overflow-wrap: anywhere; }
thead th { border-bottom: 2px solid #888; white-space: nowrap; }
tbody th { font-weight: normal; white-space: nowrap; }
td.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
.met, .failed { font-weight: 600; white-space: nowrap; }
.met { color: #00573d; }
.failed { color: #a33c00; }
.warning { background: #fff4e0; border-left: 4px solid #e69f00; padding: .4rem .7rem; }
.figures { display: grid; gap: .8rem 1rem; align-items: start; margin-top: .6rem;
  grid-template-columns: repeat(auto-fill, minmax(min(24rem, 100%), 1fr)); }
figure { margin: 0; break-inside: avoid; }
figure.page { grid-column: 1 / -1; }
figure img { width: 100%; height: auto; background: #fff; display: block; }
figcaption { font-size: .85rem; color: #444; padding: 0 0 .3rem .5rem; }
.columns { columns: 2 24rem; }
.columns section { break-inside: avoid; margin-bottom: 1rem; }
.columns h3 { margin-top: 0; }
@media print {
  body { padding: 0; font-size: 9.5pt; max-width: none; }
  .figures { grid-template-columns: 1fr 1fr; }
  .columns { columns: 2 16rem; font-size: 8pt; }
  .columns section { break-inside: auto; }
  section.run + section.run { break-before: page; }
  h2, h3 { break-after: avoid; }
  tr { break-inside: avoid; }
}
"""

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
    page = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light">\n'
        f"<title>{escape(_title(runs))}</title>\n<style>{_CSS}</style>\n</head>\n<body>\n"
        + "\n".join(body)
        + "\n</body>\n</html>\n"
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(page, encoding="utf-8")


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
        + _table(["requirement", *labels, "limit"], rows)
        + _figures(comparisons_of(records, labels), COMPARISONS, "page")
    )


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
            warnings + _pairs(facts),
            "<h3>Requirements</h3>",
            _requirements(verdict),
            "<h3>Metrics</h3>",
            _metrics(verdict.metrics),
            _disturbances(verdict.metrics),
            "<h3>Figures</h3>",
            _figures(figures_of(record), FIGURES, "column"),
            "<h3>Configuration</h3>",
            _configuration(record.parameters),
            "<h3>Versions</h3>",
            _pairs(record.metadata.items()) if record.metadata else "<p>not recorded</p>",
            "</section>",
        ]
    )


def _requirements(verdict: Verdict) -> str:
    rows = [
        f'<tr><th>{escape(each.name)}</th><td class="number">{escape(each.value_text)}</td>'
        f"<td>{escape(each.limit_text)}</td><td>{_outcome(each)}</td></tr>"
        for each in verdict.requirements
    ]
    return _table(["requirement", "value", "limit", "verdict"], rows)


def _outcome(each: Requirement) -> str:
    """Tell the verdict in words as well as in colour."""
    return '<span class="met">✓ met</span>' if each.met else '<span class="failed">✗ failed</span>'


def _metrics(metrics: Metrics) -> str:
    rows = []
    for field, name, unit in _METRICS:
        value = getattr(metrics, field)
        text = "–" if value is None else f"{number_text(value)} {unit}".rstrip()
        rows.append(f'<tr><th>{escape(name)}</th><td class="number">{escape(text)}</td></tr>')
    return _table(["metric", "value"], rows)


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
    return "<h3>Sudden disturbances</h3>\n" + _table(head, rows)


def _configuration(parameters: Mapping[str, Mapping[str, Any]]) -> str:
    if not parameters:
        return "<p>not recorded</p>"
    sections = [
        f"<section><h3>{escape(node)}</h3>{_pairs((k, _plain(v)) for k, v in values.items())}"
        "</section>"
        for node, values in parameters.items()
    ]
    return f'<div class="columns">{"".join(sections)}</div>'


def _plain(value: Any) -> str:
    """Write a parameter as in YAML."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_plain(each) for each in value) + "]"
    return str(value)


def _pairs(pairs: Iterable[tuple[str, str]]) -> str:
    rows = [f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in pairs]
    return f"<table><tbody>{''.join(rows)}</tbody></table>"


def _table(head: Sequence[str], rows: Sequence[str]) -> str:
    cells = "".join(f'<th scope="col">{escape(each)}</th>' for each in head)
    body = "\n".join(rows)
    return (
        f'<div class="wide"><table><thead><tr>{cells}</tr></thead>\n'
        f"<tbody>{body}</tbody></table></div>\n"
    )


def _figures(
    drawn: Mapping[str, Figure], captions: Mapping[str, tuple[str, Any]], width: str
) -> str:
    """Figures as images that the page carries itself."""
    shown = [
        f'<figure class="{width}"><figcaption>{escape(captions[name][0])}</figcaption>'
        f'<img alt="{escape(captions[name][0])}" src="{_data_uri(figure)}"></figure>'
        for name, figure in drawn.items()
    ]
    return f'<div class="figures">{"".join(shown)}</div>'


def _data_uri(figure: Figure) -> str:
    """SVG in an image of its own, so that the names inside it meet no other figure's."""
    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "ppc_attitude"}):  # the same page for the same run
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
