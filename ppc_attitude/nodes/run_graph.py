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

"""The nodes of a run and what they publish, as the ROS graph tells."""

from collections.abc import Iterator, Mapping
from itertools import chain

from rclpy.exceptions import InvalidNodeNameException, InvalidTopicNameException
from rclpy.node import Node

from ppc_attitude.contract.topics import (
    ESTIMATOR,
    EVENTS,
    MARKERS_TOPIC,
    NODES,
    RECORDED_TOPIC,
    RECORDER,
    STANDARD,
    Topic,
)

_SENDERS = {*NODES, ESTIMATOR}
_OURS = {MARKERS_TOPIC.name, RECORDED_TOPIC.name, *(topic.name for topic in EVENTS)}
_NAMES = {topic.name for topic in STANDARD}


class RunGraph:
    """Topics of the nodes of some runs.

    A node is of a run if it has the name of one of ours, or publishes on a topic of the contract,
    in the namespace of the run. At each instant there is a message of what is between the nodes,
    and of what the starter has told to be so; of the rest nobody knows.

    Parameters
    ----------
    node : Node
        Who looks.
    told : mapping of str to mapping of str to list of str
        For the namespace of each run, as ``/proposed`` or empty for that without a name: its nodes,
        and the topics that each sends at each instant, as far as the starter told.

    Attributes
    ----------
    nodes : set of (str, str)
        Namespace and name of every node of a run that was seen.
    promised : dict of str to set of str
        For each run the topics that must have a message at each instant.
    """

    def __init__(self, node: Node, told: Mapping[str, Mapping[str, list[str]]]) -> None:
        self._node = node
        self._known = {home: _SENDERS | nodes.keys() for home, nodes in told.items()}
        self.nodes: set[tuple[str, str]] = set()
        self.promised = {home: set(chain(*nodes.values())) for home, nodes in told.items()}

    def look(self) -> Iterator[tuple[str, Topic]]:
        """Yield every topic that a node of a run publishes now, with the run's namespace."""
        for name, namespace in set(self._node.get_node_names_and_namespaces()):
            home = namespace.rstrip("/")
            if home not in self._known or name == RECORDER:
                continue
            topics = dict(self._topics(home, name, namespace))
            if name in self._known[home] or _NAMES & topics.keys():
                self.nodes.add((home, name))
                for short, msgtype in topics.items():
                    if short in _NAMES:
                        self.promised[home].add(short)
                    column = short if short in self.promised[home] else ""
                    yield home, Topic(short, msgtype, source=name, column=column)

    def _topics(self, home: str, name: str, namespace: str) -> Iterator[tuple[str, str]]:
        """Topics of a node in the namespace of the run, without that, and their types."""
        try:
            found = self._node.get_publisher_names_and_types_by_node(name, namespace)
        except (RuntimeError, InvalidNodeNameException, InvalidTopicNameException):
            return  # it has ended meanwhile
        for topic, types in found:
            short = topic.removeprefix(f"{home}/")
            hidden = any(part.startswith("_") for part in topic.split("/"))
            inside = short != topic and short not in _OURS and topic not in _OURS
            if inside and not hidden and short != "rosout":
                yield short, types[0]
