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

"""The arguments of the launch files, and the configuration that they make."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from ppc_attitude.contract.parameters import WAIT_FOR_RECORDER
from ppc_attitude.contract.topics import CONTROLLER, MARKERS, OF_A_RUN, PLANT, RECORDER, SOURCES
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kinds import CONTROLLERS
from ppc_attitude.simulation.closed_loop import warm_up
from ppc_attitude.simulation.scenario import Scenario, check_exchange, load

_YES_NO = ("true", "false")


class Argument(NamedTuple):
    """A launch argument, as `launch` declares it; without choices it takes any text."""

    default_value: str
    description: str
    choices: tuple[str, ...] | None = None


ARGUMENTS = {
    "config": Argument(
        "paper.yaml",
        "ROS parameter files, separated by commas, later ones win; a name without a folder is a "
        "file here, or else one of this package",
    ),
    "controller": Argument(
        "", "the control law; empty: as configured", ("", *CONTROLLERS.components)
    ),
    "duration": Argument("", "simulated time [s]; 0: endless; empty: as configured"),
    "bag": Argument("", "folder of the bag; empty: a new, dated one under bags/"),
    "realtime": Argument("false", "free-running on the wall clock instead of lock-step", _YES_NO),
    "namespace": Argument("", "namespace of every node and topic"),
    "without": Argument(
        "",
        f"nodes to leave out, separated by commas, so that yours take their place: "
        f"{', '.join(OF_A_RUN)}",
    ),
    "markers": Argument("false", "show the run on `markers`, with tf2_ros also on /tf", _YES_NO),
}
SIDE_BY_SIDE = ("config", "duration", "bag", "realtime", "markers")  # what fits several runs


@dataclass(frozen=True)
class Request:
    """The arguments of one launch; those that a launch file lacks have their default."""

    values: Mapping[str, str]

    def __getitem__(self, name: str) -> str:
        """Value of an argument."""
        return self.values.get(name, ARGUMENTS[name].default_value).strip()

    def flag(self, name: str) -> bool:
        """Value of an argument that is true or false."""
        return self[name] == "true"

    def words(self, name: str) -> list[str]:
        """Parts of an argument that is a list."""
        return [word.strip() for word in self[name].split(",") if word.strip()]

    def nodes(self) -> tuple[str, ...]:
        """Executables to start, as far as the scenario needs them.

        Raises
        ------
        ConfigurationError
            A node that is to be left out is none.
        """
        left_out = self.words("without")
        for name in left_out:
            if name not in OF_A_RUN:
                raise ConfigurationError(
                    f"without: {name} is no node; allowed: {', '.join(OF_A_RUN)}"
                )
        extra = (MARKERS,) if self.flag("markers") else ()
        return (*(name for name in OF_A_RUN if name not in left_out), *extra)

    def scenario(self, config: Path, overlay: Sequence[Path] = ()) -> Scenario:
        """Checked parameters of every node.

        A name may stand for a file of the package, in the folder `config`. The files of the overlay
        override those that the user names.

        Raises
        ------
        ConfigurationError
            A file or value is wrong.
        """
        files = [_file(name, config) for name in self.words("config")]
        recorded = RECORDER in self.nodes()
        overrides: dict[str, dict[str, Any]] = {
            name: {WAIT_FOR_RECORDER.name: recorded} for name in SOURCES
        }
        overrides[PLANT]["lockstep"] = not self.flag("realtime")
        if self["duration"]:
            overrides[PLANT]["duration"] = _number("duration", self["duration"])
        if self["controller"]:
            overrides[CONTROLLER]["controller"] = self["controller"]
        if self["bag"]:
            overrides[RECORDER] = {"bag": self["bag"]}
        scenario = load([*files, *overlay], overrides)
        if not self.words("without"):  # what a node of the user sends is not known
            check_exchange(scenario.parameters)
        warm_up(scenario)  # once here, instead of in several processes at a time
        return scenario


def _file(name: str, config: Path) -> Path:
    own = config / name
    return own if own.name == name and own.is_file() and not Path(name).is_file() else Path(name)


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ConfigurationError(f"{name} = {text!r}; allowed: a number") from None
