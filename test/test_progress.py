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

"""How often the progress bar is drawn, where a terminal draws over it, and where nothing does."""

import io
import sys
from pathlib import Path

import pytest
from conftest import Ask

from ppc_attitude.command_line.progress import progress_bar


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("stream", "environment", "interval"),
    [(Terminal, {}, 0.1), (io.StringIO, {}, 10.0), (io.StringIO, {"TQDM_MININTERVAL": "1"}, 0.1)],
    ids=["terminal", "file", "as asked"],  # tqdm itself reads the variable when it is imported
)
def test_a_bar_fills_no_file(
    stream: type[io.StringIO],
    environment: dict[str, str],
    interval: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("TQDM_MININTERVAL")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "stderr", stream())
    with progress_bar(total=3.0) as bar:
        assert bar.mininterval == interval
        bar.update(1.0)
        bar.update(2.0)
    assert "3.0/3.0" in sys.stderr.getvalue()


def test_a_search_of_many_generations_fills_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ask: Ask
) -> None:
    monkeypatch.delenv("TQDM_MININTERVAL")
    monkeypatch.setattr("ppc_attitude.falsify.search.evaluated", lambda *_: 0.0)
    told = ask("falsify", "--duration=5", "--pieces=3", "--runs=130", f"--out={tmp_path}").err
    assert told.count("\r") < 5, "ten generations, each with a line of its own"
