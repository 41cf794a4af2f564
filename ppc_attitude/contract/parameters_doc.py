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

"""The page of all parameters, written from their declarations.

python -m ppc_attitude.contract.parameters_doc > docs/parameters.md
"""

import sys
from collections.abc import Iterable, Sequence

from ppc_attitude.contract.parameters import PARAMETERS
from ppc_attitude.contract.topics import HOSTED
from ppc_attitude.science.component import Component
from ppc_attitude.science.kinds import all_components
from ppc_attitude.science.parameter import Parameter

_HEAD = """# Parameters

Written by `python -m ppc_attitude.contract.parameters_doc > docs/parameters.md` from what the nodes
declare and check; `ros2 param describe` shows the same. Numbers are doubles unless an integer is
asked for. A value that is not allowed is refused, at start and by `ros2 param set`, with a message
that names it, its value and what is allowed. *at start*: has effect only at start.
"""
_COLUMNS = ("parameter", "default", "unit", "allowed", "description")


def page() -> str:
    """Return the whole page, in Markdown."""
    parts = [_HEAD]
    for node, table in PARAMETERS.items():
        parts.append(f"## `{node}`\n")
        components = tuple(all_components(HOSTED.get(node, ())))
        if len(components) > 1:
            parts.append("*used by* names the components that read a parameter.\n")
        parts.append(_table(table, components))
    return "\n".join(parts)


def _table(parameters: Iterable[Parameter], components: Sequence[Component]) -> str:
    several = len(components) > 1
    columns = (*_COLUMNS, "used by") if several else _COLUMNS
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
    """Return a value as YAML takes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, str):
        return f'"{value}"'
    text = repr(value)
    return text if "." in text else text.replace("e", ".0e")  # YAML takes 3e-05 for a text


if __name__ == "__main__":
    sys.stdout.write(page())
