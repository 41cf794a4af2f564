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

"""Clean by ROS's own linters, in the house style: double quotes, 100 columns, numpydoc.

ruff, which knows more rules, sorts the imports and judges the docstrings of the tests.
"""

from pathlib import Path

import pytest
from ament_flake8.main import main_with_errors as flake8
from ament_pep257.main import main as pep257
from craft_helpers import ROOT
from test_layers import PACKAGE

long = pytest.mark.long  # ruff knows these rules and is quicker
SOURCES = [name for name in (PACKAGE, "bench", "launch", "setup.py") if (ROOT / name).exists()]


@pytest.fixture(autouse=True)
def in_root(monkeypatch: pytest.MonkeyPatch) -> None:
    """The linters name files relative to where they run."""
    monkeypatch.chdir(ROOT)


@long
def test_flake8() -> None:
    status, errors = flake8(["--config", str(Path("setup.cfg")), *SOURCES, "test"])
    assert status == 0, "\n".join(errors)


@long
def test_pep257(capsys: pytest.CaptureFixture[str]) -> None:
    # D401: pydocstyle takes every noun for a wrong verb; ruff judges the mood. D403: a sentence may
    # begin with a symbol, and ω is not Ω. D104: the __init__.py of a package is empty.
    ignored = ["D104", "D401", "D403"]
    arguments = ["--convention", "numpy", "--add-ignore", *ignored, "--", *SOURCES]
    assert pep257(arguments) == 0, capsys.readouterr().out


def test_copyright(capsys: pytest.CaptureFixture[str]) -> None:
    copyright_ = pytest.importorskip("ament_copyright.main", reason="it is not on PyPI")
    found = ["LICENSE", "CONTRIBUTING.md", *SOURCES, "test", "docs"]
    assert copyright_.main(found) == 0, capsys.readouterr().err
