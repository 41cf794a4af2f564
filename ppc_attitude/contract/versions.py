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

"""Versions of everything that can change a number of a run."""

import platform
import subprocess
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from ppc_attitude import __version__
from ppc_attitude.science.kinds import KINDS

_PACKAGES = ("numpy", "numba", "scipy", "rosbags", "rclpy")
_INDIFFERENT = {"python", "rosbags", "rclpy", "git_revision"}  # no version of these changes numbers


def versions_of_others() -> dict[str, str]:
    """Versions of the packages that add components, by name."""
    return {p.dist.name: p.dist.version for kind in KINDS for p in kind.points if p.dist}


@cache
def versions() -> dict[str, str]:
    """Versions of this package, Python, the packages below it, and those that add components.

    The git revision too, if there is one.
    """
    found = {"ppc_attitude": __version__, "python": platform.python_version()}
    for package in _PACKAGES:
        with suppress(PackageNotFoundError):
            found[package] = version(package)
    found |= versions_of_others()
    revision = _git_revision()
    if revision:
        found["git_revision"] = revision
    return found


def of_another_state(metadata: Mapping[str, str]) -> str:
    """Say that a run was made by another state of this package; empty if nothing tells so.

    Its components may send other topics and compute otherwise than those that are here.

    Parameters
    ----------
    metadata : mapping of str to str
        The `versions` with which the run was made.
    """
    here = versions()
    for name in ("git_revision", "ppc_attitude"):
        was, now = metadata.get(name), here.get(name)
        if was and now and was != now:
            return f"the run was made by another ppc_attitude ({name} {was}, here {now})"
    return ""


def of_another_worker(made_with: Mapping[str, str]) -> str:
    """Say that this process, a worker, has other `versions` than a command; empty if it has not."""
    there = versions()
    different = [
        f"{name} {there.get(name, 'absent')} there, {here} here"
        for name, here in made_with.items()
        if name not in _INDIFFERENT and there.get(name) != here
    ]
    told = "a worker has other versions than this command, so its results could differ"
    return f"{told}: {', '.join(different)}" if different else ""


def _git_revision() -> str:
    folder = Path(__file__).resolve().parents[2]
    if not (folder / ".git").exists():
        return ""
    # `describe --dirty` would take the lock of the user's index, and leave it behind if killed.
    git = ["git", "--no-optional-locks", "-C", str(folder)]
    try:
        revision, changed = (
            subprocess.run(git + asked, capture_output=True, text=True, timeout=10, check=True)
            for asked in (
                ["describe", "--always", "--abbrev=40"],
                ["status", "--porcelain", "-uno"],
            )
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return revision.stdout.strip() + ("-dirty" if changed.stdout else "")
