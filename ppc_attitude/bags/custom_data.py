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

"""What a bag says besides messages: facts about its run, and whether it is finished.

The facts are rosbag2's custom data, under our own keys; the folder holds a mark and a lock while
the bag is being recorded.
"""

import fcntl
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from ppc_attitude.bags.errors import BagError, all_printable, printable, shortened
from ppc_attitude.contract.parameters import PARAMETERS
from ppc_attitude.contract.whole_file import write_whole
from ppc_attitude.contract.yaml_file import parsed, parsed_json
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.parameter import NodeParameters

METADATA = "metadata.yaml"
UNFINISHED = "unfinished.json"  # custom data of a bag that is being recorded, or was cut
CONTROLLER_KEY = "ppc_attitude.controller"
PARAMETERS_KEY = "ppc_attitude.parameters"
METADATA_KEY = "ppc_attitude.metadata"
RECOVERED_KEY = "ppc_attitude.recovered"  # why the recording was cut before it was recovered
GAPS_KEY = "ppc_attitude.gaps"  # what the recorder knows to be incomplete
UNKNOWN_CONTROLLER = "unknown"
_RUN_INFO = (  # what a starter may tell, what that is of each node, and in words
    ("samples", list, " with the list of topics of each node"),
    ("parameters", dict, " with the object of parameters of each node"),
    ("metadata", object, ""),
)


def custom_data_of(said: Any) -> dict[str, str]:
    """Custom data in the parsed metadata of a bag, or in its mark of an unfinished bag."""
    custom = said.get("custom_data") if isinstance(said, dict) else None
    return {str(k): str(v) for k, v in custom.items()} if isinstance(custom, dict) else {}


def custom_data_in(metadata: str) -> dict[str, str]:
    """Custom data in the copy of ``metadata.yaml`` that a storage file holds.

    Raises
    ------
    ValueError
        The text is not YAML, nests too deeply, or is too large.
    """
    return custom_data_of(parsed(metadata)) if "custom_data" in metadata else {}


class RunFacts(NamedTuple):
    """Controller, parameters by node and metadata of a run.

    The flaws say which facts cannot be read and why, and what the recorder knew to be incomplete.
    """

    controller: str
    parameters: NodeParameters
    metadata: Mapping[str, str]
    flaws: tuple[str, ...]


def read_run_info(text: str) -> dict[str, Any]:
    """Return what the starter of a run tells its recorder; nothing if the text is empty.

    Raises
    ------
    ConfigurationError
        The text is not JSON, or something in it is of another type than the recorder relies on.
    """
    try:
        content = parsed_json(text or "{}")
    except ValueError as error:
        raise ConfigurationError(f"run_info is not JSON: {error}") from None
    if not isinstance(content, dict):
        raise ConfigurationError(f"run_info = {content!r}; allowed: a JSON object")
    for name, kind, of_each in _RUN_INFO:
        nodes = content.get(name, {})
        fits = isinstance(nodes, dict) and all(isinstance(each, kind) for each in nodes.values())
        if fits and kind is list:
            fits = all(isinstance(topic, str) for topics in nodes.values() for topic in topics)
        if not fits:
            raise ConfigurationError(f"run_info: {name} = {nodes!r}; allowed: an object{of_each}")
    return content


def encode_custom_data(
    controller: str, parameters: NodeParameters, metadata: Mapping[str, str]
) -> dict[str, str]:
    """Return the custom data of a bag that states these facts.

    The parameters are those of each node, by its name, with its namespace where there is one; the
    metadata are versions, seed and git revision.
    """
    return {
        CONTROLLER_KEY: controller,
        PARAMETERS_KEY: json.dumps(parameters, ensure_ascii=False),
        METADATA_KEY: json.dumps(metadata, ensure_ascii=False),
    }


def decode_custom_data(custom_data: Mapping[str, str], namespace: str) -> RunFacts:
    """Return the facts that custom data state about the run in a namespace.

    What is absent or unreadable is empty, the controller then ``unknown``. All texts are printable.
    """
    flaws: list[str] = []
    told = _told(custom_data, PARAMETERS_KEY, dict, flaws)
    parameters = of_namespace({n: v for n, v in told.items() if isinstance(v, dict)}, namespace)
    parameters = {node: usable(node, values, flaws) for node, values in parameters.items()}
    metadata = _told(custom_data, METADATA_KEY, dict, flaws)
    gaps = _told(custom_data, GAPS_KEY, list, flaws)
    flaws += [f"the recorder calls the bag incomplete: {gap}" for gap in gaps]
    return RunFacts(
        printable(custom_data.get(CONTROLLER_KEY) or UNKNOWN_CONTROLLER),
        parameters,
        {key: str(value) for key, value in metadata.items()},
        tuple(flaws),
    )


def usable(node: str, values: Mapping[str, Any], flaws: list[str]) -> dict[str, Any]:
    """Return the parameters of a node, without known ones of a value that it could not have."""
    left = dict(values)
    for known in PARAMETERS.get(node, ()):
        try:
            if known.name in values:
                known.checked(values[known.name])
        except ConfigurationError as error:
            named = known.choices and not known.is_list and isinstance(values[known.name], str)
            if not named:  # else it may be a component that is not installed here
                del left[known.name]
                flaws.append(f"the bag's parameters of {node} cannot be used: {shortened(error)}")
    return left


def of_namespace(nodes: Mapping[str, Any], namespace: str) -> dict[str, Any]:
    """Facts about the nodes of a namespace, by the node's bare name.

    A bare name stands for a node of every namespace; one with a namespace goes before it.
    """
    found = {}
    for node, said in sorted(nodes.items(), key=lambda each: "/" in each[0]):
        home, slash, name = node.rpartition("/")
        if not slash or f"/{home.strip('/')}".rstrip("/") == namespace:
            found[name] = said
    return found


def _told(custom_data: Mapping[str, str], key: str, kind: Any, flaws: list[str]) -> Any:
    """Content of a JSON text if it is of one kind, such as dict; else an empty one of that kind."""
    try:
        value = all_printable(parsed_json(custom_data.get(key, "null")))
    except ValueError as error:
        flaws.append(f"the bag's {key} cannot be read: {error}")
        return kind()
    return value if isinstance(value, kind) else kind()


def write_unfinished(folder: Path, custom_data: Mapping[str, str]) -> None:
    """Mark the bag in a folder as unfinished and keep its custom data, in one atomic step."""
    write_whole(folder / UNFINISHED, json.dumps({"custom_data": dict(custom_data)}))


def claimed(folder: Path) -> bool:
    """Whether a living process holds a bag's folder."""
    try:
        os.close(_locked(folder, fcntl.LOCK_SH))
    except OSError as error:  # or no folder, or a file system without locks
        return isinstance(error, BlockingIOError)
    return False


def claim(folder: Path) -> int:
    """Lock a bag's folder until the descriptor is closed or the process is gone.

    Raises
    ------
    BagError
        Another living process holds it.
    """
    try:
        return _locked(folder, fcntl.LOCK_EX)
    except BlockingIOError as error:
        raise BagError(f"{folder} is still being recorded") from error


def _locked(folder: Path, kind: int) -> int:
    """Descriptor of a folder with a lock; BlockingIOError if another one is in its way."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor
