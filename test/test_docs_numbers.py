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

"""The numbers of the documentation are those that the code gives."""

import re
import runpy
import sys
from pathlib import Path

import pytest
from conftest import Ask
from craft_helpers import CONFIG, ROOT, overlay
from docs_helpers import EXAMPLES, blocks, described, table
from process_helpers import PAPER

from ppc_attitude.contract.topics import CONTROLLER


def test_verdict_of_the_readme_is_what_is_printed(ask: Ask) -> None:
    (shown,) = (block for block in blocks(ROOT / "README.md", "text") if "requirement" in block)
    assert shown.strip() in ask("simulate", "--config", PAPER).out


def numbers(text: str) -> list[float]:
    return [float(each) for each in re.findall(r"(?<![\w.])-?\d+\.?\d*(?:e[-+]?\d+)?", text)]


def is_among(number: float, stated: list[float]) -> bool:
    """True if the page states the number, up to what another machine's rounding may change."""
    return any(abs(number - each) <= 0.005 * abs(number) for each in stated)


@pytest.mark.slow
@pytest.mark.parametrize("whole", [False, pytest.param(True, marks=pytest.mark.long)])
def test_numbers_of_the_theory_are_measured(
    whole: bool, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """All of them, or those that runs of the laws have, and not what 200000 attitudes say."""
    stated = numbers((ROOT / "docs" / "theory.md").read_text(encoding="utf-8").replace("−", "-"))
    monkeypatch.setattr(sys, "argv", ["theory_numbers.py"])
    example = runpy.run_path(str(EXAMPLES / "theory_numbers.py"))
    if whole:
        example["main"]()
    else:
        paper = example["load"]([PAPER])
        for part in ("task", "along_the_run", "largest_start", "sample_times", "saturated"):
            example[part](paper)
        example["margins"](paper)
        for part in ("cross_term_ratio", "hits", "benchmark"):
            example[part]()
    for line in capsys.readouterr().out.splitlines():
        for number in numbers(line):
            assert is_among(number, stated), line


@pytest.mark.parametrize("column", [1, 2, 3])
def test_sweep_of_the_theory_is_measured(column: int, tmp_path: Path, ask: Ask) -> None:
    auto = overlay(tmp_path / "auto.yaml", {CONTROLLER: {"envelope": "auto"}})
    file = {1: PAPER, 2: CONFIG / "no_widening.yaml", 3: auto}[column]
    told = ask("sweep", "--config", PAPER, "--config", file, "--json").json
    assert list(told) == described("sweep")
    hits = told["hits"]
    rows = table(ROOT / "docs" / "theory.md", "| hit [s] |")
    assert [float(row[0]) for row in rows] == [hit["duration_s"] for hit in hits]
    for row, hit in zip(rows, hits, strict=True):
        recovery = hit["recovery_time_s"]
        if row[column].startswith("not"):
            assert recovery is None or recovery > 60.0
        else:
            assert float(row[column]) == pytest.approx(recovery, rel=0.05)


def test_comparison_of_the_theory_is_measured(ask: Ask, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    rows = table(ROOT / "docs" / "theory.md", "| | settled [s] | largest rate")
    assert len(rows) == 3
    for options, settled, rate, recovered in rows:
        given = ["--config", "config/paper.yaml", "--config", "config/comparison_hit.yaml"]
        fails = int(options != "--controller ppc")
        told = ask("simulate", *given, *options.split(), "--json", code=fails)
        metrics = told.json["metrics"]
        assert float(settled) == pytest.approx(metrics["settling_time_s"], rel=0.005)
        assert float(rate) == pytest.approx(metrics["max_rate_deg_s"], rel=0.005)
        recovery = metrics["disturbances"][0]["recovery_time_s"]
        if recovered.startswith("not"):
            assert recovery is None
        else:
            assert float(recovered) == pytest.approx(recovery, rel=0.05)


def test_conditions_of_the_theory_are_measured(ask: Ask) -> None:
    lines = ask("check", "--config", PAPER).out.splitlines()
    printed = {line.split("  ")[0]: line for line in lines if line}
    rows = table(ROOT / "docs" / "theory.md", "| | value | holds |")
    assert [row[0] for row in rows] == ["S1", "S2", "S3", "S4", "S5"]
    for name, value, holds in rows:
        words = printed[name].removeprefix(name).split()
        assert float(value.replace("−", "-")) == pytest.approx(float(words[0]), rel=1e-3)
        assert holds.startswith("yes") == ("holds" in words)
