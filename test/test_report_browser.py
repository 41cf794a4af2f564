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

"""The report in a browser, as a reader sees it: a picture of the page in headless Chromium."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from synthetic import hit_run, with_columns, without_columns

from ppc_attitude.analysis.drawing import AXIS_COLOURS
from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.report import write_report
from ppc_attitude.contract.run_record import RunRecord

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), "")
OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--dump-dom",
    "--window-size=1000,9000",
    "--virtual-time-budget=5000",
)
pytestmark = pytest.mark.skipif(not CHROMIUM, reason="there is no Chromium on this machine")


def seen(run: RunRecord, folder: Path, script: str) -> tuple[str, np.ndarray]:
    """What the page becomes when a reader does what the script does, and a picture of it."""
    page, picture = folder / "report.html", folder / "report.png"
    write_report([Verdict(run)], page)
    text = page.read_text(encoding="utf-8")
    page.write_text(text.replace("</body>", f"<script>{script}</script></body>"), encoding="utf-8")
    browser = [CHROMIUM, *OPTIONS, f"--user-data-dir={folder / 'user'}", f"--screenshot={picture}"]
    done = subprocess.run(
        [*browser, page.as_uri()], capture_output=True, text=True, check=True, timeout=500
    )
    return done.stdout, imread(picture)[:, :, :3]


def pixels(picture: np.ndarray, colour: str) -> int:
    """How many pixels have a colour, written #rrggbb."""
    wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    return int((np.abs(picture * 255 - wanted).max(axis=2) < 2).sum())


@pytest.mark.slow
def test_figures_can_be_zoomed_and_the_attitude_be_seen(tmp_path: Path) -> None:
    clicks = "document.querySelectorAll('figure button').forEach((each) => each.click());"
    replay = "const s = document.querySelector('.replay input'); s.value = 700; s.oninput();"
    run = hit_run(90.0)
    run = with_columns(run, rate_error=9.0 * run["rate_error"])  # far outside: a logarithmic axis
    dom, picture = seen(run, tmp_path, clicks + replay)
    figures = dom.count("<figure")
    assert figures == dom.count(">back to the drawing</button>") == 8
    assert dom.count('class="uplot') >= figures
    assert ">envelope x" in dom
    assert "attitude error, angle [deg]" in dom  # the label of a chart, of its own text
    (told,) = re.findall(r"<span> ([\d.]+) s, torque (.*?) N·m</span>", dom)
    assert float(told[0]) > 0.0 and len(told[1].split(", ")) == 3
    heights = [float(each) for each in re.findall(r'"u-wrap" style="[^"]*height: ([\d.]+)px', dom)]
    assert max(heights) > 7.5 * len("rate error / envelope, logarithmic beyond ±1 [1]")  # not cut
    assert all(pixels(picture, colour) > 300 for colour in AXIS_COLOURS)


@pytest.mark.slow
def test_the_replay_fits_its_picture_and_shows_no_attitude_in_a_gap(tmp_path: Path) -> None:
    """With all axes at their limit, and the torque straight up; then where nothing is on record."""
    run = hit_run(3.0, hits=())
    half = 0.5 * np.arccos(1.0 / np.sqrt(3.0))  # turns (1, 1, 1) to z
    axis = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    attitude = np.tile([*(np.sin(half) * axis), np.cos(half)], (len(run.t), 1))
    attitude[200:] = np.nan
    torque = np.full((len(run.t), 3), 0.05)
    run = with_columns(run, attitude=attitude, applied_torque=torque)
    run = without_columns(run, "reference_attitude")
    script = """
      const [c, s] = ['canvas', 'input'].map((e) => document.querySelector(`.replay ${e}`));
      const inked = (y, h) => c.getContext('2d').getImageData(0, y, c.width, h).data.some((e) => e);
      const told = [inked(0, 1), inked(0, c.height)];
      s.value = 250; s.oninput();
      document.title = [...told, inked(0, c.height)].join(' ');
    """
    dom, _ = seen(run, tmp_path, script)
    assert "<title>false true false</title>" in dom
    assert "no attitude on record</span>" in dom


@pytest.mark.long
def test_an_attitude_without_a_reference_is_seen_as_well(tmp_path: Path) -> None:
    run = hit_run(2.0, hits=())
    alone = without_columns(run, *(set(run.columns) - {"attitude"}))
    dom, _ = seen(alone, tmp_path, "")
    assert "<canvas" in dom and re.search(r"<span> 0\.00 s</span>", dom)
