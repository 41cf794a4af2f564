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

"""The tables of `make bench` and of docs/performance.md, from the figures of build/bench.json."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

Figures = Mapping[str, Any]
_PERCENTILES = ("p50_us", "p99_us", "p999_us")


def tables(results: Figures) -> str:
    """Every table for which there are figures, as Markdown."""
    parts = []
    if "machine" in results:
        parts.append(machine_line(results["machine"]))
    comparisons = list(_comparisons(results))
    if comparisons:
        head = ("", "ours", "yardstick", "ratio", "goal")
        parts.append(markdown(head, comparisons))
    lockstep = results.get("lockstep", {})
    for what, found in (("", lockstep), (" with sensors", lockstep.get("sensors", {}))):
        if "cpu_us_per_step" in found:
            parts.append(_step_line(what, found["cpu_us_per_step"]))
    if "latency" in results:
        parts.append(_latency(results["latency"]))
    if "scaling" in results:
        parts.append(_scaling(results["scaling"]))
    return "\n\n".join(parts)


def markdown(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Lay out a table with columns as wide as their longest cell."""
    cells = [list(head), *map(list, rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = [
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |"
        for row in cells
    ]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def number(value: float | None, digits: int = 3) -> str:
    """Write a figure with so many significant digits, a large one without exponent."""
    if value is None:
        return "–"
    if abs(value) >= 1e6:
        return f"{value / 1e6:.{digits}g} M"
    return f"{value:.0f}" if abs(value) >= 10 ** (digits - 1) else f"{value:.{digits}g}"


def machine_line(machine: Figures) -> str:
    """On what the figures were measured."""
    versions = ", ".join(
        f"{name.replace('_', ' ')} {version[:12]}" for name, version in machine["versions"].items()
    )
    return (
        f"Measured on {machine['cores']} cores, load average {machine['load']:.1f} before the "
        f"start; {versions}."
    )


def _comparisons(results: Figures) -> Iterator[tuple[str, ...]]:
    """Rows of ours beside a yardstick, with the goal."""

    def row(name: str, ours: float, yardstick: str, theirs: float, goal: str) -> tuple[str, ...]:
        return name, number(ours), f"{yardstick}: {number(theirs)}", number(ours / theirs), goal

    if "lockstep" in results:
        found = results["lockstep"]
        steps, bare = found["steps_per_s"], found["bare_steps_per_s"]
        messages = found["messages_steps_per_s"]
        yield row("lock-step over DDS, steps/s", steps, "bare step", bare, "0.8, 1000 steps/s")
        yield row("lock-step over DDS, steps/s", steps, "its messages, no work", messages, "")
        if "sensors" in found:
            sensing = number(found["sensors"]["steps_per_s"])
            yield "lock-step with sensors, steps/s", sensing, "", "", "1000 steps/s"
    if "in_process" in results:
        found = results["in_process"]
        for law, goal in (("compiled", "10"), ("numba", ""), ("python", "")):
            theirs = found[f"basilisk_{law}"]
            name = "in process, simulated s/s"
            yield row(name, found["sim_s_per_s"], f"Basilisk, {law}", theirs, goal)
        if "sensors" in found:
            each, name = found["sensors"], "in process with sensors, simulated s/s"
            theirs = each["basilisk_compiled"]
            yield row(name, each["sim_s_per_s"], "Basilisk, compiled", theirs, "3500 s/s")
            step = f"{number(each['us_per_step'])} µs"
            yield "in process with sensors, a step in all", step, "", "", ""
    if "campaign" in results:
        found = results["campaign"]
        ours, theirs = found["runs_per_s"], found["basilisk_runs_per_s"]
        yield row("campaign, runs of 120 s/s", ours, "Basilisk's Monte Carlo", theirs, "20")
        if "sensors" in found:
            each, name = found["sensors"], "campaign with sensors, runs of 120 s/s"
            ours, theirs = each["runs_per_s"], each["basilisk_runs_per_s"]
            yield row(name, ours, "Basilisk's Monte Carlo", theirs, "20")
    if "bag_reading" in results:
        for storage, found in (
            ("MCAP", results["bag_reading"]),
            ("SQLite", results["bag_reading"]["sqlite3"]),
        ):
            ours, theirs = found["messages_per_s"], found["rosbags_messages_per_s"]
            yield row(f"reading {storage}, messages/s", ours, "rosbags, typed", theirs, "5")
    if "start_up" in results:
        found = results["start_up"]
        for which, goal in (("first", "30 s"), ("second", "5 s")):
            seconds = f"{number(found[f'{which}_run_s'])} s"
            yield f"start-up to the first step, {which} run", seconds, "", "", goal


def _step_line(what: str, used: Figures) -> str:
    parts = ", ".join(f"`{name}` {number(value)}" for name, value in used.items())
    together = number(sum(used.values()))
    return f"CPU time of a step in lock-step{what} [µs]: {parts}; together {together}."


def _latency(found: Iterable[Figures]) -> str:
    who = {"controller": "", "echo": "echo_", "sleep": "sleep_"}
    columns = [f"{name} p50, p99, p99.9 [µs]" for name in who]
    head = ["rate [Hz]", "priority", *(cell for name in columns for cell in (name, "missed"))]
    rows = [
        [
            number(each["rate"], 4),
            f"FIFO {each['priority']}" if each.get("priority") else "",
            *(cell for prefix in who.values() for cell in _trips(each, prefix)),
        ]
        for each in found
    ]
    return markdown(head, rows)


def _trips(each: Figures, prefix: str) -> tuple[str, str]:
    percentiles = ", ".join(number(each[prefix + name]) for name in _PERCENTILES)
    return percentiles, f"{each[f'{prefix}missed']} of {each[f'{prefix}sent']}"


def _scaling(found: Iterable[Figures]) -> str:
    head = (
        "what is changed",
        "steps/s of all",
        "CPU a step [µs]",
        "memory of a craft [MB]",
        "bag [bytes a step]",
    )
    keys = ("steps_per_s", "cpu_us_per_step", "memory_mb", "bag_bytes_per_step")
    return markdown(head, [[each["what"], *(number(each[key]) for key in keys)] for each in found])
