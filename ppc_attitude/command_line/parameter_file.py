"""Resolved parameters as the ROS parameter file with which a node is started."""

import json
import sys
from collections.abc import Mapping
from typing import Any

import yaml

from ppc_attitude.contract.topics import RECORDER
from ppc_attitude.simulation.scenario import Scenario


def parameter_file(scenario: Scenario) -> str:
    """Return the resolved parameters of every node; the recorder's say what it records."""
    return ros_parameters(
        {
            **scenario.parameters,
            RECORDER: {**scenario.parameters[RECORDER], "run_info": run_info(scenario.parameters)},
        }
    )


def ros_parameters(nodes: Mapping[str, Mapping[str, Any]]) -> str:
    """Return parameters by node, in whatever namespace it runs, as a ROS parameter file."""
    # rcl knows no type for an empty list; it is the default, and stays away.
    content = {
        f"/**/{node}": {
            "ros__parameters": {name: value for name, value in values.items() if value != []}
        }
        for node, values in nodes.items()
    }
    return yaml.safe_dump(content, allow_unicode=True)


def run_info(nodes: Mapping[str, Mapping[str, Any]]) -> str:
    """Return what the recorder is to know of a run: parameters by node, and the command."""
    return json.dumps({"parameters": nodes, "metadata": {"command": " ".join(sys.argv)}})
