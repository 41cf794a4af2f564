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

"""How a verdict is told to a terminal."""

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.truth import EXACT, STANDING
from ppc_attitude.analysis.verdict import Disturbance, ErrorSize, number_text, torque_text
from ppc_attitude.science.stamps import instant

_MOST_CHANGES = 20  # that are shown: a stream of goals has thousands


def verdict_table(verdict: Verdict) -> str:
    """Tell the verdict to a terminal: what was judged, a table of requirements, disturbances.

    The last line has no line break.
    """
    record = verdict.record
    cells = [("requirement", "value", "limit", "judged [s]", "verdict")]
    cells += [
        (each.name, each.value_text, each.limit_text, each.span_text, each.outcome)
        for each in verdict.requirements
    ]
    name, value, limit, span, _ = (max(len(row[k]) for row in cells) for k in range(5))
    rows = [
        f"{row[0]:<{name}}  {row[1]:>{value}}  {row[2]:<{limit}}  {row[3]:<{span}}  {row[4]}"
        for row in cells
    ]
    lines = [
        f"{record.source}: controller {record.controller}, {instant(verdict.duration_s)} s, "
        f"{verdict.t.size} instants, {record.missing_messages} missing messages",
        STANDING[verdict.truth.standing],
        "",
        rows[0],
        "-" * max(len(row) for row in rows),
        *rows[1:],
    ]
    lines += [f"{each.name}: {each.note}" for each in verdict.requirements if each.note]
    kinds = verdict.errors[:1] if verdict.truth.standing == EXACT else verdict.errors
    lines += [error_text(each) for each in kinds if each.max_deg is not None]
    lines += [disturbance_text(each) for each in verdict.metrics.disturbances]
    lines += [f"fault: {each}" for each in verdict.faults]
    if verdict.changes:
        shown, left = verdict.changes[:_MOST_CHANGES], len(verdict.changes) - _MOST_CHANGES
        more = (f"{left} more, all of them with --json",) if left > 0 else ()
        lines.append(f"parameters changed in flight: {'; '.join([*shown, *more])}")
    return "\n".join(lines)


def error_text(error: ErrorSize) -> str:
    """One of the three attitude errors in one line."""
    return (
        f"{error.name} error ({error.meaning}): at most {number_text(error.max_deg or 0.0)} deg, "
        f"{number_text(error.rms_deg or 0.0)} deg RMS, from {error.span_text} s"
    )


def disturbance_text(disturbance: Disturbance) -> str:
    """One sudden disturbance in one line."""
    return (
        f"sudden disturbance at {instant(disturbance.start_s)} s, ({torque_text(disturbance)}) N·m "
        f"for {disturbance.duration_s:g} s: {disturbance.outcome}, "
        f"judged by {disturbance.judged_by}"
    )
