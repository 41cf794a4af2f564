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

"""The report of a campaign: one self-contained HTML page."""

import shlex
from collections.abc import Sequence
from html import escape
from pathlib import Path

import yaml

from ppc_attitude.analysis.page import (
    Html,
    asked,
    collapsed,
    configuration,
    figures,
    pairs,
    table,
    write_page,
)
from ppc_attitude.analysis.verdict import number_text
from ppc_attitude.campaign.campaign import Finished
from ppc_attitude.campaign.declaration import Campaign
from ppc_attitude.campaign.figures import bands_figure, failing_figure
from ppc_attitude.campaign.quantile_bands import UNKNOWN
from ppc_attitude.campaign.summary import SAMPLE_SIZE, Fraction, Summary
from ppc_attitude.campaign.variables import varying

_BANDS = (
    "Attitude error of all runs (top) and the part of its envelope that it fills (bottom): "
    "the largest value in each time bin; dashed: 5 % and 95 % quantiles of the envelopes"
)
_FAILING = (
    f"Where runs fail, over the drawn variables that separate failing runs best: the first "
    f"{SAMPLE_SIZE} that meet every requirement and the first {SAMPLE_SIZE} that do not"
)


def write_campaign_report(
    campaign: Campaign,
    finished: Finished,
    again: Sequence[str],
    path: Path,
    *,
    mission: str = "",
    date: str = "",
) -> None:
    """Write the report of a campaign that has been run; mission, date and path as `write_report`.

    `again` is the command line that runs one index again when ``--only INDEX`` is appended.
    """
    summary = finished.summary
    title = f"{mission or 'Attitude control'}, campaign: {campaign.scenario.controller.name}"
    varied = yaml.safe_dump(dict(campaign.declaration), sort_keys=False, allow_unicode=True)
    absent = summary.runs - int(finished.bands.counts[0, -1, :UNKNOWN].sum())
    bands = f"{_BANDS}; without {absent} runs that broke or diverged" if absent else _BANDS
    drawn = [(bands, bands_figure(finished.bands, campaign.required))]
    failing = failing_figure(summary.passing, summary.failing, varying(campaign.variables))
    if failing is not None:
        drawn.append((_FAILING, failing))
    body = [
        _outcome(finished),
        _facts(campaign, finished),
        "<h2>Requirements</h2>",
        _requirements(summary),
        "<h2>Figures</h2>",
        figures(drawn, "page"),
        "<h2>Worst cases</h2>",
        _worst(summary, again),
        "<h2>What varies</h2>",
        f"<pre>{escape(varied)}</pre>",
        asked(campaign.required),
        collapsed("Configuration", configuration(campaign.scenario.parameters)),
        collapsed("Versions", pairs(campaign.made_with.items())),
    ]
    write_page(path, title, date, body)


def _outcome(finished: Finished) -> str:
    fraction = finished.summary.fraction
    style = "met" if fraction.met == fraction.judged == finished.total else "failed"
    return (
        f'<p class="{style}">{fraction.met} of {fraction.judged} runs meet every requirement that '
        f"they are judged by: {fraction}</p>"
    )


def _facts(campaign: Campaign, finished: Finished) -> str:
    summary = finished.summary
    facts = [
        ("runs", f"{summary.runs} of {finished.total}, {campaign.duration:g} s each"),
        ("seed", str(campaign.seed)),
        ("results", str(finished.folder)),
    ]
    warnings = ""
    if summary.runs < finished.total:
        warnings += '<p class="warning">The campaign was stopped before its end.</p>\n'
    if summary.first_broken is not None:
        index, reason = summary.first_broken
        warnings += (
            f'<p class="warning">{summary.broken} runs broke and were not judged; they count as '
            f"not meeting every requirement. The first: run {index}: {escape(reason)}</p>\n"
        )
    return warnings + pairs(facts)


def _requirements(summary: Summary) -> str:
    rows = [
        _row(name, tally.limit_text, tally.fraction, tally.not_judged)
        for name, tally in summary.requirements()
    ]
    rows += [_row(name, "", fraction, 0) for name, fraction in summary.shares()]
    note = "<p>A run is judged by the requirements that apply to it. 95 % Wilson intervals.</p>"
    numbers = ("met", "judged", "not judged", "share (95 % interval)")
    head = [("requirement", "name"), ("limit", ""), *((title, "number") for title in numbers)]
    return note + table(head, rows)


def _row(name: str, limit: str, fraction: Fraction, not_judged: int) -> list[str]:
    style = ("failed", "met")[fraction.met == fraction.judged] if fraction.judged else "open"
    counts = (str(each) for each in (fraction.met, fraction.judged, not_judged))
    share = Html(f'<span class="{style}">{fraction}</span>')
    return [name, limit, *counts, share]


def _worst(summary: Summary, again: Sequence[str]) -> str:
    """Worst runs of each requirement that some run failed, and how to run one again."""
    rows = []
    for name, tally in summary.requirements():
        if tally.met == tally.judged:
            continue
        runs = ", ".join(f"{index} ({_value(value)})" for index, value in tally.worst_runs())
        command = shlex.join([*again, "--only", str(tally.worst_runs()[0][0])])
        rows.append((name, runs, Html(f"<code>{escape(command)}</code>")))
    if not rows:
        return "<p>No run failed a requirement.</p>"
    head = [("requirement", "name"), ("run (value), worst first", ""), ("to repeat the worst", "")]
    return table(head, rows)


def _value(value: float) -> str:
    return "never" if value == float("inf") else number_text(value)
