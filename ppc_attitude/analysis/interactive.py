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

"""Scripts in the page itself that make its figures zoomable and replay an attitude."""

import base64
import json
import re
from importlib.resources import files
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ppc_attitude.analysis.measure import Measured
from ppc_attitude.analysis.series import has, is_finite
from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import APPLIED_TORQUE, REFERENCE_ATTITUDE

_FRAMES = 1500  # of a replay
_WEB = files(__package__) / "web"


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
    return {
        "label": _plain(axes.get_ylabel()),
        "scale": axes.get_yscale(),
        "limits": None if axes.get_autoscaley_on() else axes.get_ylim(),
        "bands": [_band(each) for each in axes.patches if _is_band(axes, each)],
        "lines": [_line(axes, each) for each in axes.get_lines() if _is_line(axes, each)],
    }


def _is_line(axes: Axes, line: Line2D) -> bool:
    """Whether it is a line over time: no mark of a hit, no entry of a legend alone."""
    mark = line.get_transform() == axes.get_xaxis_transform()
    return len(np.asarray(line.get_xdata())) > 1 and not mark


def _is_band(axes: Axes, patch: Patch) -> bool:
    """Whether it is a band over all of the ordinate, such as that of a fault."""
    return bool(patch.get_data_transform() == axes.get_xaxis_transform())


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
