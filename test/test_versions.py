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

"""What a run was made with."""

import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from threading import Event
from typing import Any
from unittest.mock import Mock

import numba
import numpy
import pytest
from craft_helpers import ROOT
from process_helpers import ran
from synthetic import without_columns

from ppc_attitude.bags.reader import read_run
from ppc_attitude.bags.run_writer import write_run
from ppc_attitude.contract.versions import of_another_state, versions
from ppc_attitude.falsify.goals import Goal
from ppc_attitude.falsify.search import Search
from ppc_attitude.processes.exits import RunError
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import scenario


def test_the_git_revision_is_that_of_the_checkout() -> None:
    if not (ROOT / ".git").exists():
        pytest.skip("no checkout of git")
    asked = ["git", "-C", str(ROOT), "rev-parse", "HEAD"]
    revision = ran(asked).stdout.strip()
    assert versions()["git_revision"].removesuffix("-dirty").endswith(revision)


def test_what_can_change_a_number_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ppc_attitude.contract.versions.versions_of_others", lambda: {"own": "1.2"})
    expected = {"own": "1.2", "numpy": numpy.__version__, "numba": numba.__version__}
    assert expected.items() <= versions.__wrapped__().items()


@pytest.mark.skipif(shutil.which("git") is None, reason="no git")
def test_the_git_revision_is_that_of_the_packages_own_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A package in an environment within somebody's checkout has no revision."""
    home = tmp_path / "home"
    file = home / "ppc_attitude" / "contract" / "versions.py"
    file.parent.mkdir(parents=True)
    file.write_text("")
    monkeypatch.setattr("ppc_attitude.contract.versions.__file__", str(file))
    git = ["git", "-C", str(home), "-c", "user.name=a", "-c", "user.email=a@b.c"]
    for asked in (["init", "-q"], ["add", "."], ["commit", "-qm", "a"]):
        assert "git_revision" not in versions.__wrapped__()
        ran([*git, *asked], env={"GIT_CONFIG_GLOBAL": os.devnull})
    revision = ran([*git, "rev-parse", "HEAD"]).stdout.strip()
    assert versions.__wrapped__()["git_revision"] == revision
    file.write_text("# changed\n")
    assert versions.__wrapped__()["git_revision"] == f"{revision}-dirty"
    (home / ".git").rename(tmp_path / ".git")
    assert "git_revision" not in versions.__wrapped__()


@pytest.mark.parametrize("name", ["ppc_attitude", "git_revision"])
def test_a_run_of_another_state_of_the_package_is_told(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = {"ppc_attitude": "0.1.0", "git_revision": "a"}
    monkeypatch.setattr("ppc_attitude.contract.versions.versions", lambda: here)
    told = f"the run was made by another ppc_attitude ({name} other, here {here[name]})"
    assert of_another_state({**here, name: "other"}) == told
    assert not of_another_state(here)
    assert not of_another_state({})
    run = dict(here)
    del here["git_revision"]  # as where it is installed from no checkout
    assert not of_another_state(run)


def test_a_topic_that_another_state_of_the_package_may_not_have_sent_is_told_as_that(
    tmp_path: Path,
) -> None:
    run = without_columns(simulate(scenario({}), 0.1), "auxiliary_state")
    write_run(replace(run, metadata={"ppc_attitude": "0.0.1"}), tmp_path / "bag")
    (warning,) = read_run(tmp_path / "bag").warnings
    assert warning.startswith("the bag lacks messages of control/auxiliary_state; the run was made")
    assert warning.endswith(", whose nodes may not send them")


def test_a_worker_of_a_search_with_other_versions_refuses(tmp_path: Path) -> None:
    """One without the package of a component blamed the configuration."""

    def submit(task: Callable[..., float], made_with: Mapping[str, str], *rest: Any) -> float:
        return task({**made_with, "of_a_law": "1.0"}, *rest)

    adversary = Search(Mock(size=2, to_json=dict), Goal("terminal"), tmp_path, seed=1)
    told = r"a worker has other versions .*: of_a_law absent there, 1\.0 here"
    with pytest.raises(RunError, match=told):
        next(adversary.run(9, 60.0, Mock(submit=submit), Event()))
