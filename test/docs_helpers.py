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

"""The pages of the documentation, taken apart: commands, tables, files to save."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from craft_helpers import ROOT

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
EXAMPLES = ROOT / "docs" / "examples"


class Command(NamedTuple):
    page: Path
    text: str

    @property
    def words(self) -> list[str]:
        return shlex.split(self.text, comments=True)

    def __str__(self) -> str:
        return f"{self.page.name}: {self.text}"


def blocks(page: Path, language: str) -> list[str]:
    """The fenced blocks of a page in one language."""
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def commands(page: Path) -> Iterator[Command]:
    """Every command of a page's bash blocks, continued lines joined."""
    for block in blocks(page, "bash"):
        for line in block.replace("\\\n", " ").splitlines():
            if line.strip() and not line.startswith("#"):
                yield Command(page, line.strip())


def table(page: Path, head: str) -> list[list[str]]:
    """Rows of the table whose first line begins so, without the backticks."""
    lines = page.read_text(encoding="utf-8").splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith(head))
    rows = []
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        cells = re.split(r"(?<!\\)\|", line)[1:-1]
        rows.append([cell.strip().strip("`") for cell in cells])
    return rows


def described(command: str) -> list[str]:
    """Keys of what a command prints with --json, as the reference describes them."""
    return [row[0] for row in table(ROOT / "docs/reference.md", f"| key of `{command}` |")]


def saved_files(page: Path) -> dict[str, str]:
    """Files that a page tells to save, by name."""
    text = page.read_text(encoding="utf-8")
    found = re.findall(
        r"[Ss]ave this as `(\S+)`:\n\n```yaml\n(.*?)^```$", text, re.MULTILINE | re.DOTALL
    )
    return dict(found)


ALL = [command for page in PAGES for command in commands(page)]
