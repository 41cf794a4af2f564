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

"""Write the generated parts of the pages: tables of the code, listings, measurements.

A part stands between ``<!-- generated: NAME -->`` and ``<!-- end -->``.

python docs/generate.py
"""

import argparse
import ast
import json
import re
import runpy
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from ppc_attitude.command_line.launching import ARGUMENTS, SIDE_BY_SIDE
from ppc_attitude.command_line.main import parsers
from ppc_attitude.contract.declared import TOPICS
from ppc_attitude.contract.parameters import PARAMETERS
from ppc_attitude.contract.topics import (
    DIAGNOSTICS_TOPIC,
    HOSTED,
    MARKERS_TOPIC,
    NODE_OF,
    PARAMETER_EVENTS_TOPIC,
    Topic,
)
from ppc_attitude.science.component import Component
from ppc_attitude.science.kinds import KINDS, NONE, all_components
from ppc_attitude.science.parameter import Parameter

ROOT = Path(__file__).parents[1]
PAGES = (
    "docs/tutorial.md",
    "docs/reference.md",
    "docs/parameters.md",
    "docs/performance.md",
)
_DOCSTRING = '"""'
_PART = re.compile(r"(<!-- generated: (\S+) -->\n).*?(<!-- end -->)", re.DOTALL)


def nodes() -> str:
    """The table of nodes, by the first line of each one's file, which names it first."""
    rows = ["| node | does |", "|---|---|"]
    for node in PARAMETERS:
        file = ROOT / "ppc_attitude" / "nodes" / f"{node}.py"
        line = str(ast.get_docstring(ast.parse(file.read_text(encoding="utf-8")))).splitlines()[0]
        rows.append(f"| `{node}` | {line.partition(': ')[2].rstrip('.')} |")
    return "\n".join(rows)


def topics() -> str:
    """The table of topics."""
    shown = [topic for topic in (*TOPICS, MARKERS_TOPIC) if topic is not PARAMETER_EVENTS_TOPIC]
    head = "| topic | type | frame_id | from | meaning |\n|---|---|---|---|---|"
    return "\n".join([head, *map(_topic_row, shown)])


def _topic_row(topic: Topic) -> str:
    source = topic.source or ("every node" if topic is DIAGNOSTICS_TOPIC else "anyone")
    unit = f" [{topic.unit}]" if topic.unit not in ("", "1") else ""
    kind = topic.msgtype.replace("/msg/", "/")
    return f"| `{topic.name}` | {kind} | {topic.frame_id} | {source} | {topic.meaning}{unit} |"


def commands() -> str:
    """Every command with its arguments."""
    return "\n\n".join(_command(name, parser) for name, parser in parsers()[1].choices.items())


def _command(name: str, parser: argparse.ArgumentParser) -> str:
    lines = [f"### `{name}`", "", str(parser.description), ""]
    lines += ["| argument | means |", "|---|---|", *_argument_rows(parser)]
    return "\n".join(lines)


def _argument_rows(parser: argparse.ArgumentParser) -> Iterator[str]:
    formatter = parser.formatter_class(prog="")
    for action in parser._actions:
        if action.dest == "help":
            continue
        text = formatter._expand_help(action) if action.help else ""
        if action.choices:
            text += ": " + ", ".join(f"`{each}`" for each in action.choices)
        yield f"| `{_label(action)}` | {text.replace('|', '&#124;')} |"


def _label(action: argparse.Action) -> str:
    names = action.metavar if isinstance(action.metavar, tuple) else (action.metavar,)
    value = " ".join(str(name or ("NAME" if action.choices else "N")) for name in names)
    if action.nargs in ("+", "*"):
        value += " …"
    if not action.option_strings:
        return value
    return " ".join([", ".join(action.option_strings), *([] if action.nargs == 0 else [value])])


def launch() -> str:
    """Every argument of the launch files."""
    head = "| launch argument | default | means | only in |\n|---|---|---|---|"
    rows = [
        f"| `{name}` | {each.default_value} | {each.description} | "
        f"{'' if name in SIDE_BY_SIDE else '`paper.launch.py`'} |"
        for name, each in ARGUMENTS.items()
    ]
    return "\n".join([head, *rows])


def kinds() -> str:
    """The kinds of component that another package may add, in their order within an instant."""
    head = "| group | selected by | of node | must give | what ours read |\n|---|---|---|---|---|"
    rows = [head]
    for kind in filter(lambda each: each.selector, KINDS):
        read = dict.fromkeys(c for each in kind.components.values() for c in each.inputs)
        selector = f"`{kind.selector}`" + (f", or `{NONE}`" if kind.optional else "")
        columns = [", ".join(f"`{c.name}`" for c in each) for each in (kind.gives, read)]
        cells = (f"`ppc_attitude.{kind.name}`", selector, f"`{NODE_OF[kind.name]}`", *columns)
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows)


def parameters() -> str:
    """The parameters of every node, and which of its components read each."""
    parts = []
    for node, table in PARAMETERS.items():
        parts.append(f"## `{node}`\n")
        components = tuple(all_components(HOSTED.get(node, ())))
        if len(components) > 1:
            parts.append("*used by* names the components that read a parameter.\n")
        parts.append(_table(table, components))
    return "\n".join(parts)


def _table(parameters: Iterable[Parameter], components: Sequence[Component]) -> str:
    several = len(components) > 1
    columns = ("parameter", "default", "unit", "allowed", "description")
    columns += ("used by",) if several else ()
    rows = [columns, ("---",) * len(columns)]
    for parameter in parameters:
        row = (
            f"`{parameter.name}`",
            f"`{_value(parameter.default)}`",
            parameter.unit,
            parameter.allowed + (", *at start*" if parameter.read_only else ""),
            parameter.description,
        )
        rows.append((*row, _users(parameter, components)) if several else row)
    lines = ("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows)
    return "\n".join(lines) + "\n"


def _users(parameter: Parameter, components: Sequence[Component]) -> str:
    users = [each.name for each in components if parameter in each.parameters]
    return ", ".join(users) if 0 < len(users) < len(components) else "all"


def _value(value: object) -> str:
    """Return a value as YAML takes it: like JSON, but 3e-05 would be a text."""
    text = json.dumps(value, ensure_ascii=False)
    return text if '"' in text else re.sub(r"(?<![.\d])(\d+)e", r"\1.0e", text)


def bench() -> str:
    """Tables of the last `make bench` whose figures were kept, in docs/bench.json."""
    tables = runpy.run_path(str(ROOT / "bench" / "table.py"))["tables"]
    return str(tables(json.loads((ROOT / "docs" / "bench.json").read_text(encoding="utf-8"))))


def listing(name: str) -> str:
    """A file of docs/examples as a block of code, without the header of the licence."""
    text = (ROOT / "docs" / "examples" / name).read_text(encoding="utf-8")
    return f"```python\n{text[text.index(_DOCSTRING) :]}```"


_MADE = (nodes, topics, commands, launch, kinds, parameters, bench)
_TABLES = {each.__name__: each for each in _MADE}


def generated(text: str) -> str:
    """A page with its generated parts made anew."""

    def part(match: re.Match[str]) -> str:
        head, name, end = match.groups()
        body = listing(name) if "." in name else _TABLES[name]()
        return f"{head}{body}\n{end}"

    return _PART.sub(part, text)


def main() -> None:
    """Write every page."""
    for page in PAGES:
        path = ROOT / page
        path.write_text(generated(path.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
