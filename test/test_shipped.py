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

"""Where shipped files are found."""

from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest
import yaml
from craft_helpers import CONFIG, ROOT

from ppc_attitude.command_line.paths import shipped_config
from ppc_attitude.science.errors import ConfigurationError

LAYOUTS = {
    "sources": ("ppc_attitude", "config"),
    "pip": ("lib/python3.12/site-packages/ppc_attitude", "share/ppc_attitude/config"),
    "debian": (
        "local/lib/python3.12/dist-packages/ppc_attitude",
        "local/share/ppc_attitude/config",
    ),
}


def test_the_sources_have_what_they_ship() -> None:
    assert shipped_config("campaign.yaml") == CONFIG / "campaign.yaml"


def test_no_overlay_gives_a_parameter_another_type_than_the_file_below_it() -> None:
    """Where two files do, ROS keeps the value of the first: it looks for a truth value before it
    looks for a text."""
    types: dict[str, set[type]] = defaultdict(set)

    def see(name: str, value: Any) -> None:
        if isinstance(value, dict):
            for key, each in value.items():
                see(f"{name}.{key}", each)
        else:
            types[name].add(type(value))

    for path in sorted(CONFIG.glob("*.yaml")):
        for section in (yaml.safe_load(path.read_text()) or {}).values():
            if isinstance(section, dict):
                see("", section.get("ros__parameters", {}))
    assert {name: kinds for name, kinds in types.items() if len(kinds) > 1} == {}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_installation_is_searched(tmp_path: Path, layout: str) -> None:
    package, config = (tmp_path / part for part in LAYOUTS[layout])
    package.mkdir(parents=True)
    with pytest.raises(ConfigurationError, match=r"config/mine\.yaml is not installed with "):
        shipped_config("mine.yaml", package)
    config.mkdir(parents=True)
    (config / "mine.yaml").touch()
    assert shipped_config("mine.yaml", package) == config / "mine.yaml"


def test_a_linked_package_leads_to_its_sources(tmp_path: Path) -> None:
    """As `colcon build --symlink-install` leaves it."""
    link = tmp_path / "build" / "ppc_attitude"
    link.parent.mkdir()
    link.symlink_to(ROOT / "ppc_attitude")
    assert shipped_config("campaign.yaml", link) == CONFIG / "campaign.yaml"
