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

"""The documentation is current: its links lead somewhere, its tables are those of the code."""

import re
import runpy
from pathlib import Path

import pytest
from conftest import Ask
from craft_helpers import ROOT
from docs_helpers import PAGES, table

from ppc_attitude.contract.parameters import PARAMETERS
from ppc_attitude.contract.topics import BESIDE, OF_A_RUN

GENERATE = runpy.run_path(str(ROOT / "docs" / "generate.py"))


@pytest.mark.parametrize("page", [ROOT / name for name in GENERATE["PAGES"]], ids=lambda p: p.name)
def test_generated_parts_are_current(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert "<!-- generated: " in text
    assert GENERATE["generated"](text) == text, "run: python docs/generate.py"


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_resolve(page: Path) -> None:
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    links = re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(r'src="([^"]+)"', text)
    for link in links:
        if re.match(r"https?:|mailto:", link):
            continue
        target, _, anchor = link.partition("#")
        path = (page.parent / target).resolve() if target else page
        assert path.exists(), f"{page.name} links to {link}"
        if anchor:
            titles = re.findall(r"^#+ (.+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
            slugs = {re.sub(r"[^\w\- ]", "", title).lower().replace(" ", "-") for title in titles}
            assert anchor in slugs, f"{page.name} links to {link}"


def test_tests_that_pages_name_exist() -> None:
    files = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "test").glob("*.py")}
    named = {
        name
        for page in PAGES
        for name in re.findall(r"`(?:test/)?(test_\w+(?:\.py)?)`", page.read_text(encoding="utf-8"))
    }
    assert {name for name in named if name.endswith(".py")} <= files.keys()
    for name in named - files.keys():
        assert any(f"def {name}(" in text for text in files.values()), name


def test_json_is_described_key_by_key(ask: Ask) -> None:
    printed = ask("simulate", "--duration", 1, "--json").json
    page = ROOT / "docs/reference.md"
    assert [row[0] for row in table(page, "| key |")] == list(printed)
    assert [row[0] for row in table(page, "| metric |")] == list(printed["metrics"])


def test_every_node_and_configuration_is_listed() -> None:
    page = ROOT / "docs/reference.md"
    assert {row[0] for row in table(page, "| node |")} == set(PARAMETERS) == {*OF_A_RUN, *BESIDE}
    listed = {row[0] for row in table(page, "| file |")}
    assert listed == {f"config/{path.name}" for path in (ROOT / "config").glob("*.yaml")}
