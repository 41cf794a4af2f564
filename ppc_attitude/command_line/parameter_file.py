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

"""Parameters as a ROS parameter file: those with which a node is started, or an overlay."""

import json
import shlex
import sys
from collections.abc import Iterable, Mapping
from typing import Any

import yaml

from ppc_attitude.contract.declared import BY_COLUMN, components_of, nodes_of, samples_of
from ppc_attitude.contract.topics import RECORDER, STANDARD
from ppc_attitude.science.component import read_from_elsewhere
from ppc_attitude.science.parameter import NodeParameters
from ppc_attitude.simulation.scenario import Scenario


def parameter_file(scenario: Scenario) -> str:
    """Return the resolved parameters of every node; the recorder's say what it records."""
    known = {name: scenario.parameters[name] for name in nodes_of(scenario.parameters)}
    return ros_parameters(scenario.with_values(RECORDER, run_info=run_info(known)).parameters)


def ros_parameters(nodes: NodeParameters) -> str:
    """Return parameters by node, in whatever namespace it runs, as a ROS parameter file."""
    # An empty list, for which rcl knows no type, is the default, and left out. Lists are copied,
    # because YAML would write an alias, which rcl does not know, for a list that occurs twice.
    content = {
        f"/**/{node}": {
            "ros__parameters": {
                name: [*value] if isinstance(value, list) else value
                for name, value in values.items()
                if value != []
            }
        }
        for node, values in nodes.items()
    }
    return yaml.safe_dump(content, default_flow_style=None, sort_keys=False, allow_unicode=True)


def overlay(comment: Iterable[str], nodes: NodeParameters) -> str:
    """Return parameters by node as a ROS parameter file with a comment of some lines at its top."""
    return "".join(f"# {line}\n" for line in comment) + ros_parameters(nodes)


def run_info(nodes: NodeParameters) -> str:
    """Return what the recorder is to know of a run.

    These are the parameters by node, the topics on which each node has a message at every instant,
    because the recorder loads no component, and the command.
    """
    samples = {name: _topics(name.rpartition("/")[2], values) for name, values in nodes.items()}
    metadata = {"command": shlex.join(sys.argv)}
    return json.dumps({"parameters": nodes, "samples": samples, "metadata": metadata})


def _topics(node: str, values: Mapping[str, Any]) -> list[str]:
    """Topics that a node sends at every instant, and those that it reads.

    What it reads may come from a node of the user's, whose name nobody knows; topics that every run
    has are known, and need not come.
    """
    read = read_from_elsewhere(components_of(node, values))
    wanted = [BY_COLUMN[column.name] for column in read if not column.late]
    topics = (*samples_of(node, values), *(topic for topic in wanted if topic not in STANDARD))
    return [topic.name for topic in topics]
