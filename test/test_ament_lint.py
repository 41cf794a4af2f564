"""Clean by ROS's own linters, in the house style: double quotes, 100 columns, numpydoc.

ruff, which knows more rules, sorts the imports and judges the docstrings of the tests.
"""

from pathlib import Path

import pytest
from ament_flake8.main import main_with_errors as flake8
from ament_pep257.main import main as pep257
from test_layers import PACKAGE, ROOT

SOURCES = [name for name in (PACKAGE, "launch", "setup.py") if (ROOT / name).exists()]


@pytest.fixture(autouse=True)
def in_root(monkeypatch: pytest.MonkeyPatch) -> None:
    """The linters name files relative to where they run."""
    monkeypatch.chdir(ROOT)


def test_flake8() -> None:
    status, errors = flake8(["--config", str(Path("setup.cfg")), *SOURCES, "test"])
    assert status == 0, "\n".join(errors)


def test_pep257(capsys: pytest.CaptureFixture[str]) -> None:
    # D401: pydocstyle takes every noun for a wrong verb; ruff judges the mood. D403: a sentence may
    # begin with a symbol, and ω is not Ω.
    arguments = ["--convention", "numpy", "--add-ignore", "D401", "D403", "--", *SOURCES]
    assert pep257(arguments) == 0, capsys.readouterr().out
