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

"""The nodes of a run: what they publish, by the ROS graph, and their parameters, when asked."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from math import inf
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.exceptions import InvalidNodeNameException, InvalidTopicNameException
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future
from rclpy.validate_topic_name import validate_topic_name

from ppc_attitude.bags.writer import BagWriter
from ppc_attitude.contract.parameters import is_of_ros
from ppc_attitude.contract.topics import (
    ATTITUDE,
    CLOCK_TOPIC,
    EVENTS,
    MARKERS_TOPIC,
    OF_A_RUN,
    PARAMETER_EVENTS_TOPIC,
    PLANT,
    RECORDED_TOPIC,
    RECORDER,
    SOURCES,
    STANDARD,
    Topic,
)
from ppc_attitude.nodes.base import BaseNode
from ppc_attitude.nodes.messages import message_class
from ppc_attitude.nodes.parameters import with_lists
from ppc_attitude.nodes.running import check_name
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.parameter import unquoted

_UNSEEN = 2.5  # [s] for which a node may have been there before it is seen
_PERIOD = 1.0  # [s] after which a node that has not told its parameters is asked again
_OURS = {MARKERS_TOPIC.name, RECORDED_TOPIC.name, *(topic.name for topic in EVENTS)}
_NAMES = {topic.name for topic in STANDARD}


class RunGraph:
    """Topics of the nodes of some runs, as far as they can be recorded.

    A node belongs to a run if, in the run's namespace, it has the name of one of our nodes, or
    publishes on a topic of the contract, on one that the starter has told, or on one that such a
    node reads. Topics between the nodes, and those that the starter has told, have a message at
    each instant; of other topics this is not known.

    Parameters
    ----------
    node : BaseNode
        The node that looks at the graph.
    told : mapping of str to mapping of str to list of str
        For the namespace of each run, as ``/proposed`` or empty for that without a name: its nodes,
        and the topics that each sends at each instant, as far as the starter told.

    Attributes
    ----------
    nodes : set of (str, str)
        Namespace and name of every node of a run that was seen.
    promised : dict of str to set of str
        For each run the topics that must have a message at each instant.
    awaited : dict of str to set of str
        Of those that the starter has told, the ones of all nodes but the plant.
    """

    def __init__(self, node: BaseNode, told: Mapping[str, Mapping[str, list[str]]]) -> None:
        self._node = node
        self._known = {home: set(OF_A_RUN) | nodes.keys() for home, nodes in told.items()}
        self.nodes: set[tuple[str, str]] = set()
        self.promised = {home: set(chain(*nodes.values())) for home, nodes in told.items()}
        self.awaited = {
            home: self.promised[home].difference(nodes.get(PLANT, ()))
            for home, nodes in told.items()
        }
        self._read: dict[str, set[str]] = {home: set(_NAMES) for home in told}
        self._sources = {
            f"{home}/{topic}": (home, topic, node)
            for home, nodes in told.items()
            for node, topics in nodes.items()
            for topic in topics
        }

    def look(self) -> Iterator[tuple[str, Topic]]:
        """Yield every topic that a node of a run publishes now, with the run's namespace."""
        seen = self._node.get_node_names_and_namespaces()
        found = {
            (name, namespace, namespace.rstrip("/"))
            for name, namespace in seen
            if namespace.rstrip("/") in self._known and name != RECORDER
        }
        for name, namespace, home in found:
            if name in self._known[home]:
                ask = self._node.get_subscriber_names_and_types_by_node
                self._read[home].update(dict(self._topics(ask, home, name, namespace)))
        for name, namespace, home in found:
            ask = self._node.get_publisher_names_and_types_by_node
            topics = dict(self._topics(ask, home, name, namespace))
            shared = self._read[home] | self.promised[home]
            if name in self._known[home] or shared & topics.keys():
                self.nodes.add((home, name))
                for short, msgtype in topics.items():
                    if short in _NAMES:
                        self.promised[home].add(short)
                    column = short if short in self.promised[home] else ""
                    if self._can_be_written(short, msgtype):
                        yield home, Topic(short, msgtype, source=name, column=column)
        if len(set(seen)) < len(seen):  # of two nodes by one name ROS tells the topics of one
            for full, (msgtype, *_) in self._node.get_topic_names_and_types():
                if full in self._sources:
                    home, short, name = self._sources[full]
                    yield home, Topic(short, msgtype, source=name, column=short)

    def _can_be_written(self, name: str, msgtype: str) -> bool:
        reason = "" if BagWriter.knows(msgtype) else f"its type {msgtype} is not in ROS 2 Jazzy"
        try:
            message_class(msgtype)
        except (ImportError, AttributeError) as error:
            reason = str(error)
        if reason:
            self._node.complain(name, f"{name} is not recorded: {reason}")
        return not reason

    def _topics(
        self, ask: Callable[..., Any], home: str, name: str, namespace: str
    ) -> Iterator[tuple[str, str]]:
        """Topics that a node has in the namespace of the run, without that, and their types."""
        try:
            found = ask(name, namespace)
        except (RuntimeError, InvalidNodeNameException, InvalidTopicNameException):
            return  # it has ended meanwhile
        for topic, types in found:
            short = topic.removeprefix(f"{home}/")
            hidden = any(part.startswith("_") for part in topic.split("/"))
            inside = short != topic and short not in _OURS and topic not in _OURS
            if inside and not hidden and short != "rosout":
                yield short, types[0]


def homes_of(node: Node, namespaces: Sequence[str]) -> list[str]:
    """Return the full namespaces of some runs, as of `RunGraph`; an empty one is the node's own.

    Raises
    ------
    ConfigurationError
        There is none, ROS does not take one, or two runs would have a topic in common.
    """
    if not namespaces:
        raise ConfigurationError("namespaces = []; allowed: at least one; '' is this node's")
    homes: dict[str, None] = {}
    for namespace in namespaces:
        states = f"{namespace.rstrip('/')}/{ATTITUDE.name}" if namespace else ATTITUDE.name
        check_name(validate_topic_name, states, f"namespaces: {namespace!r}")
        full = node.resolve_topic_name(states, only_expand=True)
        homes[full.removesuffix(f"/{ATTITUDE.name}")] = None
    names = Counter(f"{home}/{topic.name}" for home in homes for topic in STANDARD)
    name, runs = names.most_common(1)[0]
    if runs > 1:
        told = f"namespaces = {list(namespaces)}: {name} would be a topic of {runs} runs"
        raise ConfigurationError(f"{told}; allowed: namespaces that share no topic")
    return list(homes)


def comes_with_state(topic: Topic) -> bool:
    """Whether a topic that is no sample's may come with each state, or each answer to one."""
    return topic == CLOCK_TOPIC or (topic.source in SOURCES and topic not in EVENTS)


def telling(topics: Sequence[Topic]) -> list[str]:
    """Names of those topics of a node by whose first message it is known when the node began."""
    samples = [topic.name for topic in topics if topic.column]
    return samples or [topic.name for topic in topics if comes_with_state(topic)]


class ParameterSurvey:
    """Ask every node of some runs for its parameters when it appears, if no starter has told them.

    A node that is started again is asked again: its values may differ. After each answer
    `on_answer` gets the namespace of the run, as of `RunGraph`, the node's name, its parameters,
    and since when it may have been there, by the wall clock [s].
    """

    def __init__(
        self,
        node: Node,
        graph: RunGraph,
        on_answer: Callable[[str, str, dict[str, Any], float], None],
    ) -> None:
        self._node = node
        self._graph = graph
        self._on_answer = on_answer
        self._clients: dict[tuple[str, str], tuple[Any, Any]] = {}
        # Namespace and name of each node that has answered, by an id that is new at each start.
        self._answered: dict[bytes, tuple[str, str]] = {}
        self._since: dict[bytes, float] = {}
        self._asked: dict[bytes, float] = {}  # when each was asked last, by the wall clock [s]

    def ask(self, now: float) -> None:
        """Ask nodes that have not answered; an answer is lost if its node ends meanwhile."""
        for end in self._node.get_publishers_info_by_topic(PARAMETER_EVENTS_TOPIC.name):
            who, start = (end.node_namespace.rstrip("/"), end.node_name), bytes(end.endpoint_gid)
            self._since.setdefault(start, now - _UNSEEN)
            if who not in self._graph.nodes or start in self._answered:
                continue
            if who not in self._clients:
                full = "/".join(who)
                self._clients[who] = (
                    self._node.create_client(ListParameters, f"{full}/list_parameters"),
                    self._node.create_client(GetParameters, f"{full}/get_parameters"),
                )
            client, _ = self._clients[who]
            if now - self._asked.get(start, -inf) >= _PERIOD and client.service_is_ready():
                self._asked[start] = now
                future = client.call_async(ListParameters.Request())
                future.add_done_callback(partial(self._on_names, who, start))

    def _on_names(self, who: tuple[str, str], start: bytes, future: Future) -> None:
        names = [name for name in future.result().result.names if not is_of_ros(name)]
        future = self._clients[who][1].call_async(GetParameters.Request(names=names))
        future.add_done_callback(partial(self._on_values, who, start, names))

    def _on_values(
        self, who: tuple[str, str], start: bytes, names: list[str], future: Future
    ) -> None:
        answer = future.result().values
        if start in self._answered or len(answer) != len(names):
            return
        self._answered[start] = who
        values = (  # JSON knows no bytes: they become numbers
            [byte[0] for byte in each.byte_array_value] or parameter_value_to_python(each)
            for each in answer
        )
        told = dict(zip(names, (unquoted(with_lists(each)) for each in values), strict=True))
        self._on_answer(*who, told, self._since[start])

    def close(self) -> None:
        """Name the nodes that have not answered."""
        if silent := sorted(map("/".join, self._graph.nodes.difference(self._answered.values()))):
            text = f"the parameters of {', '.join(silent)} are not on record: no answer yet"
            self._node.get_logger().warning(text)
