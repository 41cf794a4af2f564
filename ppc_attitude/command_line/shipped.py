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

"""Where the files of config/ are: beside the sources, or in the share folder of an installation."""

from collections.abc import Iterator
from pathlib import Path

from ppc_attitude.science.errors import ConfigurationError


def shipped_config(name: str, package: Path | None = None) -> Path:
    """Find a file of config/.

    Parameters
    ----------
    name : str
        Such as ``campaign.yaml``.
    package : Path, optional
        Folder of this package; default where it was imported from.

    Raises
    ------
    ConfigurationError
        This installation has no such file.
    """
    home = (package or Path(__file__).parents[1]).resolve()
    for folder in _folders(home):
        if (folder / name).is_file():
            return folder / name
    raise ConfigurationError(f"config/{name} is not where {home} is installed: name the file")


def _folders(package: Path) -> Iterator[Path]:
    yield package.parent / "config"
    # pip and colcon put the package below PREFIX/lib, and what it shares below PREFIX/share.
    for prefix in package.parents:
        yield prefix / "share" / package.name / "config"
