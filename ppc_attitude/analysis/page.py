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

"""The parts of a self-contained HTML page: frame, tables, figures, and the data of its scripts.

The scripts make figures zoomable and replay an attitude.
"""

import base64
import io
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ppc_attitude.analysis.measure import Measured
from ppc_attitude.analysis.requirements import Requirements
from ppc_attitude.analysis.series import has, is_finite
from ppc_attitude.contract.declared import parameters_in_use
from ppc_attitude.contract.parameters import PARAMETERS
from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import APPLIED_TORQUE, HOSTED, REFERENCE_ATTITUDE
from ppc_attitude.contract.whole_file import write_whole
from ppc_attitude.science.parameter import NodeParameters

_FRAMES = 1500  # of a replay
_WEB = files(__package__) / "web"


class Html(str):
    """A text that is HTML already."""


def write_page(path: Path, title: str, date: str, body: Sequence[str]) -> None:
    """Write a page with a title and a date, as plain text, and what it shows, as HTML.

    The folder of the file is made if there is none, the file is replaced if there is one.
    """
    page = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light">\n'
        f"<title>{escape(title)}</title>\n<style>{style()}</style>\n</head>\n<body>\n"
        f"<h1>{escape(title)}</h1>\n<p>{escape(date)}</p>\n"
        + "\n".join(body)
        + f"\n{script()}\n</body>\n</html>\n"
    )
    write_whole(path, page)


def collapsed(title: str, content: str) -> str:
    """Part of a page that a reader opens."""
    return f"<details><summary>{escape(title)}</summary>{content}</details>"


def asked(required: Requirements) -> str:
    """Requirements file that asks for the same, for a reader to open."""
    lines = required.to_json().items()
    return collapsed("Requirements file", pairs((name, str(value)) for name, value in lines))


def configuration(parameters: NodeParameters) -> str:
    """Parameters by node, with their units, in columns; of components, the selected ones'."""
    if not parameters:
        return "<p>not recorded</p>"
    sections = []
    for node, values in parameters.items():
        units = {each.name: each.unit for each in PARAMETERS.get(node, ())}
        others = _not_run(node, values)
        rows = [(k, f"{_written(v)} {units.get(k, '')}") for k, v in values.items()]
        shown = pairs(row for row in rows if row[0] not in others)
        sections.append(f"<section><h3>{escape(node)}</h3>{shown}</section>")
    return f'<div class="columns">{"".join(sections)}</div>'


def _not_run(node: str, values: Mapping[str, Any]) -> set[str]:
    """Parameters of a node that belong to components which it did not run."""
    others = {
        each.name
        for kind in HOSTED.get(node, ())
        if kind.optional or kind.selected(values)
        for part in kind.components.values()
        for each in part.parameters
    }
    return others - parameters_in_use(node, values).keys()


def _written(value: Any) -> str:
    """Write a parameter as a reader may give it in YAML."""
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str)


def pairs(named: Iterable[tuple[str, str]]) -> str:
    """Names and values, as plain text, in a table of two columns; nothing is `not recorded`."""
    rows = [f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in named]
    return f"<table><tbody>{''.join(rows)}</tbody></table>" if rows else "<p>not recorded</p>"


def table(head: Iterable[tuple[str, str]], rows: Iterable[Sequence[str]]) -> str:
    """Table from its head and the cells of its rows, as plain text where they are not `Html`.

    The head has what each column is called, and the style of its cells: a class of the style sheet,
    ``name`` for what names its row, or nothing.
    """
    titles, styles = zip(*head, strict=True)
    cells = "".join(f'<th scope="col">{escape(each)}</th>' for each in titles)
    body = "\n".join(
        f"<tr>{''.join(_cell(*each) for each in zip(row, styles, strict=True))}</tr>"
        for row in rows
    )
    return (
        f'<div class="wide"><table><thead><tr>{cells}</tr></thead>\n'
        f"<tbody>{body}</tbody></table></div>\n"
    )


def _cell(content: str, style: str) -> str:
    shown = content if isinstance(content, Html) else escape(content)
    if style == "name":
        return f"<th>{shown}</th>"
    return f'<td class="{style}">{shown}</td>' if style else f"<td>{shown}</td>"


def figures(captioned: Iterable[tuple[str, Figure]], width: str) -> str:
    """Captions and figures, as images that the page carries itself; width `column` or `page`."""
    shown = [
        f'<figure class="{width}" data-width="{width}"><figcaption>{escape(caption)}</figcaption>'
        f'<img alt="{escape(caption)}" src="{_data_uri(figure)}">{plotted(figure)}</figure>'
        for caption, figure in captioned
    ]
    return f'<div class="figures">{"".join(shown)}</div>'


def _data_uri(figure: Figure) -> str:
    """SVG in an image of its own, so that the names inside it meet no other figure's."""
    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "ppc_attitude"}):  # the same page for the same run
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def script() -> str:
    """Everything that runs in a page: uPlot (MIT licence), and our code that draws with it."""
    library = _text("uPlot.js") + f"\n/*\n{_text('uPlot.LICENSE')}*/\n"
    return f"<script>{library}{_text('report.js')}</script>"


def style() -> str:
    """Style sheets of uPlot and of the page.

    Colours are stated throughout and the scheme is light: a dark browser changes nothing.
    """
    return f"{_text('uPlot.css')}\n{_text('report.css')}"


def _text(name: str) -> str:
    return (_WEB / name).read_text(encoding="utf-8")


def plotted(figure: Figure) -> str:
    """Lines of a figure as data for the page; close looks are left out, since one can zoom.

    Nothing for a map, which has no lines over time.
    """
    whole = figure.axes[0].get_xlim()
    shown = [_panel(axes) for axes in figure.axes if axes.get_xlim() == whole]
    return _data(shown) if any(panel["lines"] for panel in shown) else ""


def replay(run: Measured) -> str:
    """Replay of a run's true attitude over the reference, with the applied torque."""
    if not has(run.record, run.truth.attitude):
        return ""
    step = -(-run.t.size // _FRAMES)
    columns = {"attitude": run.truth.attitude}
    others = {"reference": REFERENCE_ATTITUDE.column, "torque": APPLIED_TORQUE.column}
    columns |= {name: column for name, column in others.items() if has(run.record, column)}
    content = _data(
        {
            "t": _times(run.t[::step]),
            "columns": {
                name: _packed(
                    np.where(is_finite(run.record, column), run.record[column].T, 0.0).T[::step]
                )
                for name, column in columns.items()
            },
            "torque_limit": run.torque_limit,
        }
    )
    return (
        f'<div class="replay"><p>Solid: the craft and its axes; dashed: the reference; black: the '
        f"applied torque. Drag to turn the view.</p>{content}</div>"
    )


def _panel(axes: Axes) -> dict[str, Any]:
    # Bands of faults and marks of hits are drawn across all of the ordinate.
    across = axes.get_xaxis_transform()
    bands = [each for each in axes.patches if each.get_data_transform() == across]
    lines = [each for each in axes.get_lines() if each.get_transform() != across]
    return {
        "label": _plain(axes.get_ylabel()),
        "scale": axes.get_yscale(),
        "limits": None if axes.get_autoscaley_on() else axes.get_ylim(),
        "bands": [_band(each) for each in bands],
        # A line without points is an entry of a legend alone.
        "lines": [_line(axes, each) for each in lines if len(np.asarray(each.get_xdata())) > 1],
    }


def _band(patch: Patch) -> dict[str, Any]:
    extent = patch.get_path().get_extents(patch.get_patch_transform())
    colour = to_hex(patch.get_facecolor(), keep_alpha=True)
    return {"from": float(extent.x0), "to": float(extent.x1), "colour": colour}


def _line(axes: Axes, line: Line2D) -> dict[str, Any]:
    x, y = (np.asarray(each, dtype=np.float64) for each in line.get_data())
    if line.get_transform() == axes.get_yaxis_transform():  # a limit, all the way across
        x = np.array(axes.get_xlim())
    label = str(line.get_label())
    return {
        "x": _times(x),
        "y": _packed(y),
        "label": "" if label.startswith("_child") else _plain(label.lstrip("_")),
        "colour": to_hex(line.get_color()),
        "dashed": line.get_linestyle() != "-",
    }


def _plain(text: str) -> str:
    """Text without the marks of mathematics."""
    return re.sub(r"[${}\\]", "", text).replace("\n", " ")


def _times(t: Array) -> str:
    return _packed(t, "<f8")  # in four bytes, times after a month would be a quarter second apart


def _packed(values: Array, form: str = "<f4") -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=form).tobytes()).decode("ascii")


def _data(content: Any) -> str:
    text = json.dumps(content, ensure_ascii=False).replace("<", "\\u003c")
    return f'<script type="application/json">{text}</script>'
