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

"""The shell completes commands, options and their values."""

import os
import sys
from pathlib import Path

import pytest
from craft_helpers import ROOT
from process_helpers import COMMAND, ran


def completions(line: str, tmp_path: Path) -> list[str]:
    """What the shell is offered at the end of a command line."""
    answer = tmp_path / "completions"
    environment = {
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_IFS": "\n",
        "_ARGCOMPLETE_SUPPRESS_SPACE": "1",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(answer),
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
        "COMP_TYPE": "9",
    }
    ran(COMMAND, env=environment)
    return answer.read_text().split("\n")


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("ppc_attitude cam", ["campaign"]),
        pytest.param("ppc_attitude run --real", ["--realtime"], marks=pytest.mark.long),
        ("ppc_attitude run --controller log", ["log_barrier"]),
    ],
)
def test_completion(line: str, offered: list[str], tmp_path: Path) -> None:
    assert [word.strip() for word in completions(line, tmp_path)] == offered


def test_the_line_of_the_reference_switches_completion_on() -> None:
    page = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
    line = next(part for part in page.split("`") if "register-python-argcomplete" in part)
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = ran(["bash", "-c", f"{line} && complete -p ppc_attitude"], env={"PATH": path})
    assert "_python_argcomplete" in done.stdout


def test_completion_is_announced_to_the_shell() -> None:
    """By what argcomplete's global hook asks of the module of an entry point."""
    look = [sys.executable, "-m", "argcomplete._check_module", "ppc_attitude.command_line.main"]
    ran(look)
