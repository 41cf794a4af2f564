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

"""Parameters are declared once: YAML comments and `ros2 param dump` say the same."""

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import yaml
from craft_helpers import ROOT
from peer import call, node_apart
from process_helpers import node_here, serving, until
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import (
    get_parameter_value,
    parameter_dict_from_yaml_file,
    parameter_value_to_python,
)

from ppc_attitude.contract.parameter_files import read_files
from ppc_attitude.contract.parameters import PARAMETERS
from ppc_attitude.contract.topics import CONTROLLER, INJECTOR, PLANT, RECORDER, REFERENCE
from ppc_attitude.nodes.parameters import _quoted
from ppc_attitude.science.parameter import unquoted
from ppc_attitude.science.rate_observer import PARAMETERS as FRONT
from ppc_attitude.simulation.scenario import load

CONFIGURATIONS = [
    path
    for path in sorted((ROOT / "config").glob("*.yaml"))
    if "ros__parameters" in path.read_text(encoding="utf-8")
]
LINE = re.compile(r"^(?P<indent> *)(?P<name>[\w/*]+):(?P<value>[^#]*)(?:# (?P<comment>.*))?$")
LIST = re.compile(r"\[[^]#]*\]")  # may go over several lines
UNIT = re.compile(r"^\[(.+?)\]")


def commented(path: Path) -> Iterator[tuple[str, str, str | None]]:
    """Node, parameter name and the unit in its comment, of every value in a parameter file."""
    parents: list[tuple[int, str]] = []
    text = path.read_text(encoding="utf-8")
    for line in LIST.sub(lambda found: found[0].replace("\n", " "), text).splitlines():
        match = LINE.match(line)
        if match is None:
            assert not line.strip() or line.lstrip().startswith("#"), f"{path.name}: {line}"
            continue
        indent = len(match["indent"])
        parents = [parent for parent in parents if parent[0] < indent]
        if not match["value"].strip():
            parents.append((indent, match["name"]))
            continue
        node, _, *group = (name for _, name in parents)
        unit = UNIT.match(match["comment"] or "")
        yield node.rpartition("/")[2], ".".join([*group, match["name"]]), unit and unit[1]


@pytest.mark.parametrize("path", CONFIGURATIONS, ids=lambda path: path.stem)
def test_units_in_comments_are_those_declared(path: Path) -> None:
    found = [
        (node, name, unit)
        for entry, name, unit in commented(path)
        for node in (PARAMETERS if entry == "**" else [entry])
        if entry != "**" or name in {parameter.name for parameter in PARAMETERS[node]}
    ]
    values = read_files([path])
    assert {(node, name) for node, name, _ in found} == {
        (node, name) for node, table in values.items() for name in table
    }, "the comments of some values were not understood"
    for node, name, unit in found:
        declared = {parameter.name: parameter for parameter in PARAMETERS[node]}
        assert unit == (declared[name].unit or None), f"{node} {name}"


def test_the_papers_file_is_complete() -> None:
    """Whoever reads it sees every parameter of its law, and the defaults are the paper's case."""
    paper = load([ROOT / "config" / "paper.yaml"]).parameters
    given = read_files([ROOT / "config" / "paper.yaml"])
    law = load([]).controller
    of_the_front = {parameter.name for parameter in FRONT}  # no part of the paper's law
    own = {parameter.name for parameter in law.parameters} - of_the_front
    assert own <= set(given[CONTROLLER])
    for node, table in PARAMETERS.items():
        for parameter in table:
            if (node, parameter.name) != (PLANT, "duration"):
                assert paper[node][parameter.name] == parameter.default, (node, parameter.name)


def ask(asker: Node, node: str, service: Any, name: str, request: Any) -> Any:
    executor = SingleThreadedExecutor(context=asker.context)
    executor.add_node(asker)
    wait = partial(until, meanwhile=partial(executor.spin_once, timeout_sec=0.01))
    answer = call(asker, service, f"{node}/{name}", request, wait)
    executor.shutdown()
    return answer


def dumped(asker: Node, node: str) -> dict[str, Any]:
    """What `ros2 param dump NODE` writes, by the same two services."""
    listed = ask(asker, node, ListParameters, "list_parameters", ListParameters.Request())
    names = sorted(listed.result.names)
    request = GetParameters.Request(names=names)
    values = ask(asker, node, GetParameters, "get_parameters", request).values
    tree: dict[str, Any] = {}
    for name, value in zip(names, values, strict=True):
        *groups, last = name.split(".")
        place = tree
        for group in groups:
            place = place.setdefault(group, {})
        plain = parameter_value_to_python(value)
        place[last] = list(plain) if hasattr(plain, "typecode") else plain
    return {node: {"ros__parameters": tree}}


def assert_described(asker: Node, full_name: str) -> None:
    """`ros2 param describe` tells of every parameter what is declared."""
    table = {parameter.name: parameter for parameter in PARAMETERS[full_name.rpartition("/")[2]]}
    request = DescribeParameters.Request(names=list(table))
    answer = ask(asker, full_name, DescribeParameters, "describe_parameters", request)
    for described in answer.descriptors:
        declared = table.pop(described.name)
        unit = f" [{declared.unit}]" if declared.unit else ""
        assert described.description == declared.description + unit
        assert described.additional_constraints == declared.allowed
        assert described.read_only == declared.read_only
        for each in (*described.floating_point_range, *described.integer_range):
            assert (each.from_value, each.to_value) == (declared.low, declared.high)
    assert not table, "not described"


@pytest.fixture
def asker() -> Iterator[Node]:
    with node_apart("asker") as node:
        yield node


@pytest.mark.ros
@pytest.mark.parametrize(
    "node",
    [
        pytest.param(node, marks=() if node in {PLANT, CONTROLLER, RECORDER} else pytest.mark.long)
        for node in PARAMETERS
    ],
)
def test_param_dump_round_trips(node: str, asker: Node, tmp_path: Path) -> None:
    overlay = tmp_path / "overlay.yaml"
    overlay.write_text(
        f"/**/{PLANT}:\n  ros__parameters: {{lockstep: true, seed: 7}}\n"
        f"/**/{CONTROLLER}:\n  ros__parameters:\n    K_u: 0.25\n    rate_envelope: {{decay: 0.6}}\n"
        f"/**/{INJECTOR}:\n  ros__parameters: {{pulse_times: [2.0], pulse_durations: [0.1], "
        "pulse_torques: [0.1, 0.2, 0.3]}\n"
        f"/**/{RECORDER}:\n  ros__parameters: {{bag: {tmp_path / 'first' / 'bag'}}}\n"
    )
    given = [ROOT / "config" / "paper.yaml", overlay]

    def dump(namespace: str, files: list[Path]) -> Path:
        """Start the node with the files; dump it into another."""
        options = [option for path in files for option in ("--params-file", str(path))]
        file = tmp_path / f"{namespace.strip('/')}.yaml"
        with serving(node, "--ros-args", "-r", f"__ns:={namespace}", *options):
            file.write_text(yaml.safe_dump(dumped(asker, f"{namespace}/{node}")))
            assert_described(asker, f"{namespace}/{node}")
        return file

    first = dump("/first", given)
    assert load([first]).parameters[node] == load(given).parameters[node]
    # A dump names the node with its namespace; the second round has another, and its own bag.
    first.write_text(first.read_text().replace("/first/", "/second/"))
    second = dump("/second", [first])
    assert yaml.safe_load(second.read_text()) == yaml.safe_load(first.read_text())


def loaded(asker: Node, node: str, file: Path) -> dict[str, str]:
    """What `ros2 param load` does, by the same function of rclpy: why each name was refused."""
    parameters = list(parameter_dict_from_yaml_file(str(file)).values())
    request = SetParameters.Request(parameters=parameters)
    results = ask(asker, f"/{node}", SetParameters, "set_parameters", request).results
    names = [each.name for each in parameters]
    return {n: each.reason for n, each in zip(names, results, strict=True) if not each.successful}


@pytest.mark.ros
def test_a_dump_can_be_loaded(asker: Node, tmp_path: Path) -> None:
    """YAML takes the text of a date for a date, and rclpy then sends nothing."""
    file = tmp_path / "dump.yaml"
    with serving(REFERENCE):
        before = dumped(asker, f"/{REFERENCE}")
        file.write_text(yaml.safe_dump(before))
        assert "orbit.epoch" in loaded(asker, REFERENCE, file)  # it has effect only at start
        assert dumped(asker, f"/{REFERENCE}") == before
    assert load([file]).parameters[REFERENCE] == load([]).parameters[REFERENCE]


@pytest.mark.parametrize("text", ["2025-01-01", '{"run": {"t": 1}}', "a: b", "@b", '"', "plain"])
def test_a_text_is_the_same_after_dump_and_load(text: str) -> None:
    assert unquoted(_quoted(text)) == text
    assert get_parameter_value(_quoted(text)).string_value == text


@pytest.mark.ros
def test_param_load_gives_no_node_the_value_of_another(asker: Node, tmp_path: Path) -> None:
    """`ros2 param load` sends a node every section of the file, and tells of none whose it is."""
    file = tmp_path / "load.yaml"
    sections = (
        f"/**/{PLANT}:\n  ros__parameters: {{min_torque: 2.0e-4, max_torque: 0.04}}\n",
        f"/**/{CONTROLLER}:\n  ros__parameters: {{max_torque: 0.03, beta: 3.5}}\n",
    )
    with serving(PLANT):
        for text, refused in (
            (sections[1] + sections[0], {"max_torque", "beta"}),
            (sections[0], set()),
        ):
            file.write_text(text)
            reasons = loaded(asker, PLANT, file)
            assert set(reasons) == refused
            limit = dumped(asker, f"/{PLANT}")[f"/{PLANT}"]["ros__parameters"]["max_torque"]
            assert limit == (0.05 if refused else 0.04), reasons
            if refused:
                told = "load a file that holds this node's parameters alone"
                assert told in reasons["max_torque"]


@pytest.mark.ros
def test_param_load_takes_what_yaml_takes_for_text(asker: Node, tmp_path: Path) -> None:
    """It sends texts for 3e-05 and [3e-06], and one text for [2.8, 3e-05]: all stand in a dump."""
    file = tmp_path / "load.yaml"
    inertia = [2.8, 3e-05, 0.0, 3e-05, 2.5, 0.0, 0.0, 0.0, 1.9]
    chosen = {"inertia": inertia, "wheels": {"viscous": [4e-06]}, "faults": ["axis/x weak 1e-1"]}
    chosen["min_torque"] = 3e-05
    file.write_text(yaml.safe_dump({f"/{PLANT}": {"ros__parameters": chosen}}))
    with serving(PLANT):
        assert set(loaded(asker, PLANT, file)) == {"faults"}  # there is no such kind
        content = dumped(asker, f"/{PLANT}")[f"/{PLANT}"]["ros__parameters"]
    assert content["min_torque"] == 3e-5
    assert content["inertia"] == inertia
    assert content["wheels"]["viscous"] == [4e-06]


@pytest.mark.ros
def test_a_type_that_ros_does_not_have_and_an_unknown_name_are_refused_by_name(
    asker: Node,
) -> None:
    """For the type rclpy raises, which would end the node; of the name it tells nothing."""
    unknown = ParameterValue(type=3, double_value=1.0)
    allowed = "rate is of type 77; allowed: 0 (NOT_SET), 1 (BOOL), "
    meant = f"{PLANT} has no parameter max_torqe; did you mean max_torque?"
    with serving(PLANT):
        for name, value, reason in (
            ("rate", ParameterValue(type=77), allowed),
            ("max_torqe", unknown, meant),
        ):
            strange = [Parameter(name=name, value=value)]
            for kind, service in (
                (SetParameters, "set_parameters"),
                (SetParametersAtomically, "set_parameters_atomically"),
            ):
                answer = ask(asker, f"/{PLANT}", kind, service, kind.Request(parameters=strange))
                (each,) = answer.results if kind is SetParameters else [answer.result]
                assert not each.successful
                assert each.reason.startswith(reason)
        known = [Parameter(name="max_torque", value=ParameterValue(type=3, double_value=0.04))]
        request = SetParametersAtomically.Request(parameters=known)
        answer = ask(asker, f"/{PLANT}", SetParametersAtomically, service, request)
        assert answer.result.successful


@pytest.mark.parametrize("node", [INJECTOR, PLANT])
def test_a_node_says_what_it_is_and_which_parameters_it_has(
    node: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """As `ros2 run ppc_attitude NODE --help` asks."""
    with node_here(node, "--help") as (main, _):
        assert main() == 0
    told = capsys.readouterr().out.splitlines()
    assert any(line.startswith(f"usage: ros2 run ppc_attitude {node} ") for line in told)
    assert {f"  {each.name}" for each in PARAMETERS[node]} <= set(told)
    assert max(map(len, told)) <= 80


@pytest.mark.parametrize("node", PARAMETERS)
def test_a_file_for_all_nodes_starts_each(node: str, asker: Node) -> None:
    """A shipped overlay gives sensors and filter one set of numbers in one section."""
    files = [ROOT / "config" / name for name in ("paper.yaml", "sensors_smallsat.yaml")]
    options = [option for path in files for option in ("--params-file", str(path))]
    with serving(node, "--ros-args", "-r", "__ns:=/every", *options):
        told = yaml.safe_load(yaml.safe_dump(dumped(asker, f"/every/{node}")))
    (values,) = (each["ros__parameters"] for each in told.values())
    latency = values.get("star_tracker", {}).get("latency")
    has_one = "star_tracker.latency" in {each.name for each in PARAMETERS[node]}
    assert latency == (0.1 if has_one else None)
