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

import math
import os
import re
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from craft_helpers import CONFIG, configs, pulse

from ppc_attitude.contract.parameter_files import read_files
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.science.disturbances.pulses import scheduled_pulses
from ppc_attitude.science.environments import paper as paper_torque
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.estimators import mekf
from ppc_attitude.science.kinds import CONTROLLERS, ENVIRONMENTS, ESTIMATORS
from ppc_attitude.science.plants import rigid_body
from ppc_attitude.science.signals import REFERENCE_ATTITUDE, TRUE_ATTITUDE
from ppc_attitude.simulation.closed_loop import stamps_of
from ppc_attitude.simulation.diagram import Diagram
from ppc_attitude.simulation.scenario import (
    check_exchange,
    idle_parameters,
    load,
    scenario,
)

STAMPS = stamps_of(100.0, 0.3)


def written(folder: Path, text: str, name: str = "case.yaml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def one(node: str, body: str) -> str:
    return f"{node}:\n  ros__parameters:\n    {body}\n"


# These hold what a campaign draws and what a run is judged by, and are no scenarios.
OVERLAYS = sorted(
    path for path in CONFIG.glob("*.yaml") if path.stem not in ("campaign", "requirements")
)


@pytest.mark.parametrize("path", OVERLAYS, ids=lambda path: path.stem)
def test_every_file_of_the_project_is_a_valid_overlay_of_the_papers_case(path: Path) -> None:
    paths = [CONFIG / "paper.yaml", path]
    alone = load(paths)
    assert alone.controller.name
    needing = ("detumble", "sensors_uncalibrated")  # another overlay
    assert not idle_parameters(paths, alone) or path.stem in needing


def test_the_papers_file_has_the_papers_numbers() -> None:
    case = load(configs("paper"))
    law = case.parameters["ppc_controller"]
    assert (law["k"], law["M_omega"]) == (3.0, 0.017)
    table_1 = [law[f"attitude_envelope.{name}"] for name in FIELDS]
    assert table_1 == [1.0, 1e-4, 0.05, 60.0, 5e-3]
    table_2 = [law[f"rate_envelope.{name}"] for name in FIELDS]
    assert table_2 == [0.08, 3e-5, 0.5, 40.0, 3e-5]  # ρ_e∞ repaired
    body = rigid_body.configure(case.parameters["spacecraft_plant"])
    rounded = np.array([0.1554, 0.4271, 0.4792, 0.7509])
    assert np.allclose(body["initial_attitude"], rounded / np.linalg.norm(rounded), atol=1e-15)
    assert body["initial_rate"].tolist() == [0.0, 0.0, 0.0]


FIELDS = ("initial", "exponential_terminal", "decay", "settling_time", "terminal")


def test_later_files_win_and_overrides_win_over_files(tmp_path: Path) -> None:
    first = written(tmp_path, one("/**/ppc_controller", "{k: 2.0, beta: 5, sigma: 0.1}"), "a.yaml")
    second = written(tmp_path, one("ppc_controller", "{beta: 7.0, sigma: 0.2}"), "b.yaml")
    values = load([first, second], {"ppc_controller": {"sigma": 0.3}}).parameters["ppc_controller"]
    assert (values["k"], values["beta"], values["sigma"]) == (2.0, 7.0, 0.3)
    assert load([second, first]).parameters["ppc_controller"]["beta"] == 5.0


def test_wildcards_give_each_node_what_it_knows(tmp_path: Path) -> None:
    body = "{max_torque: 0.07, seed: 4, use_sim_time: true}"
    values = load([written(tmp_path, one("/**", body))]).parameters
    assert values["spacecraft_plant"]["max_torque"] == 0.07
    assert values["ppc_controller"]["max_torque"] == 0.07
    assert values["spacecraft_plant"]["seed"] == 4


def test_a_wildcard_with_a_name_that_no_node_knows(tmp_path: Path) -> None:
    path = written(tmp_path, one("/**", "{max_torqe: 0.07}"))
    with pytest.raises(ConfigurationError, match=r"no node has.* max_torqe; did you mean max_torq"):
        load([path])


def test_namespaces_nested_names_and_the_same_node_twice(tmp_path: Path) -> None:
    text = one("/craft/ppc_controller", "{attitude_envelope: {decay: 0.06}}")
    text += one("ppc_controller", "{attitude_envelope.settling_time: 70}")
    values = load([written(tmp_path, text)]).parameters["ppc_controller"]
    assert values["attitude_envelope.decay"] == 0.06
    assert values["attitude_envelope.settling_time"] == 70.0


@pytest.mark.parametrize("text", ["1e-4", "1.0e-4", "1E-04", "+1e-4", ".0001", "0.0001"])
def test_numbers_are_read_as_ros_reads_them(tmp_path: Path, text: str) -> None:
    path = written(tmp_path, one("spacecraft_plant", f"min_torque: {text}"))
    assert load([path]).parameters["spacecraft_plant"]["min_torque"] == 1e-4


def test_whole_numbers_and_empty_lists_are_numbers_and_lists(tmp_path: Path) -> None:
    path = written(tmp_path, one("spacecraft_plant", "{rate: 50, wait_for: []}"))
    path_2 = written(tmp_path, one("disturbance_injector", "{pulse_times: []}"), "b.yaml")
    values = load([path, path_2]).parameters
    assert isinstance(values["spacecraft_plant"]["rate"], float)
    assert values["spacecraft_plant"]["wait_for"] == []
    assert scheduled_pulses(values["disturbance_injector"]).size == 0


def test_an_error_names_the_file_that_does_not_go_with_those_before(tmp_path: Path) -> None:
    typing_error = written(tmp_path, one("ppc_controller", "{kk: 3.0}"))
    wheels, thrusters, orbit = (
        CONFIG / f"{each}.yaml" for each in ("wheels", "thrusters", "orbit")
    )
    for paths, culprit in (
        ([typing_error, orbit], typing_error),
        ([wheels, thrusters, orbit], thrusters),
        ([CONFIG / "faults.yaml", wheels, thrusters], thrusters),
        ([wheels, thrusters, typing_error], typing_error),  # which is told before that of thrusters
    ):
        with pytest.raises(ConfigurationError) as raised:
            load(paths)
        assert str(raised.value).endswith(f"; the error begins with configuration file {culprit}")
    with pytest.raises(ConfigurationError, match=r"allowed: one of \w+(, \w+)*$"):
        load([wheels], {"ppc_controller": {"controller": "nothing"}})


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("a: [1, 2", "cannot be read as YAML"),
        ("", "no node name at its top"),
        ("- 1\n- 2\n", "no node name at its top"),
        ("just text", "no node name at its top"),
        ("thruster:\n  ros__parameters: {a: 1}\n", "unknown node thruster; nodes are spacecraft"),
        ("ppc_controller: {k: 3.0}\n", "ppc_controller has no mapping ros__parameters"),
        ("ppc_controller:\n  ros__parameters: 5\n", "no mapping ros__parameters"),
        ("ppc_controller:\n", "no mapping ros__parameters"),
        ("a: {b: 1}\nc: 2\na: {d: 3}\n", "cannot be read as YAML: a is repeated in line 3"),
    ],
)
def test_files_that_are_no_parameter_files(tmp_path: Path, text: str, complaint: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(ConfigurationError, match=complaint) as raised:
        load([path])
    assert str(path) in str(raised.value)


def piped(text: str) -> Path:
    """Path of a pipe as a shell's <(…) gives it, in which a text waits."""
    reading, writing = os.pipe()
    with os.fdopen(writing, "w") as pipe:
        pipe.write(text)
    return Path(f"/dev/fd/{reading}")


def test_a_pipe_that_can_be_read_once_only_is_a_file_like_others() -> None:
    idle = "{wheels.max_speed: [400.0]}"
    paths = [CONFIG / "paper.yaml", piped(one("spacecraft_plant", idle))]
    assert idle_parameters(paths, load(paths)) == ["wheels.max_speed"]
    paths = [*configs("paper", "wheels"), piped(one("'**'", "{max_torque: 0.04}"))]
    assert idle_parameters(paths, load(paths)) == [], "the law has it"
    paths = [piped(one("ppc_controller", "{k: 2.0}")), piped(one("ppc_controller", "{kk: 3.0}"))]
    with pytest.raises(ConfigurationError, match=f"begins with configuration file {paths[1]}"):
        load(paths)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"nowhere\.yaml: No such file"):
        read_files([tmp_path / "nowhere.yaml"])
    with pytest.raises(ConfigurationError, match="Is a directory"):
        read_files([tmp_path])
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(ConfigurationError, match=r"binary\.yaml cannot be read as YAML"):
        read_files([binary])
    with pytest.raises(ConfigurationError, match=r"files = 'one\.yaml'; allowed: a list of files"):
        load("one.yaml")


IDENTITY = [1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0]
BAD: list[tuple[str, dict[str, Any], str]] = [
    ("ppc_controller", {"betta": 1.0}, "no parameter betta; did you mean beta"),
    ("ppc_controller", {"beta": -1}, "beta = -1; allowed: finite, > 0"),
    ("ppc_controller", {"controller": "pid"}, "controller = 'pid'; allowed: one of ppc, log_barr"),
    ("ppc_controller", {"envelope": "fast"}, "envelope = 'fast'; allowed: one of nominal, auto"),
    ("ppc_controller", {"inertia": IDENTITY[:8]}, "inertia .*has 8 values; allowed: .*9 values"),
    ("ppc_controller", {"inertia": [1.0, 2, 0, 2, 1, *IDENTITY[5:]]}, "controller: inertia .*posi"),
    ("spacecraft_plant", {"inertia": [-1.0, *IDENTITY[1:]]}, "plant: inertia .*positive"),
    ("spacecraft_plant", {"initial_attitude": [0, 0, 0, 0]}, "initial_attitude .*norm 0; allowed"),
    ("spacecraft_plant", {"initial_attitude": [0, 0, 0, 1.01]}, "initial_attitude .*norm 1.01"),
    ("spacecraft_plant", {"initial_attitude": [0, 0, 1]}, "initial_attitude .*has 3 values"),
    ("spacecraft_plant", {"min_torque": 0.06}, "min_torque = 0.06 N·m must be smaller than max_t"),
    ("spacecraft_plant", {"star_tracker.rate": 1e-18}, r"rate = 1e-18 Hz; .*≥ 1e-09"),
    ("spacecraft_plant", {"thrusters.specific_impulse": 5e-324}, r"impulse = 5e-324 s; .*≥ 1"),
    ("spacecraft_plant", {"rate": 0}, "rate = 0 Hz; allowed: finite, ≥ 1"),
    ("spacecraft_plant", {"seed": 1.5}, "seed = 1.5; allowed: an integer"),
    ("reference_generator", {"initial_attitude": [1, 1, 0, 0]}, "reference_generator: initial_att"),
    ("reference_generator", {"period_constant": [30, 0, 40]}, "period_constant .*allowed|= 0 s"),
    ("disturbance_injector", {"pulse_times": [1.0]}, "pulse_times has 1 values, pulse_durations 0"),
    ("disturbance_injector", {"pulse_torques": [1, 2]}, "pulse_torques .*a multiple of 3"),
    ("disturbance_injector", {"environment": 1}, "environment = 1; allowed: one of paper, orbi"),
    ("ppc_controller", {"rate_envelope.exponential_terminal": 1e-6}, "rate_envelope is infeasible"),
    ("ppc_controller", {"attitude_envelope.settling_time": 5}, "attitude_envelope is infeasible"),
    ("ppc_controller", {"C_omega": 1e300}, r"C_omega = 1e\+300 1/s; .*≤ 1e\+06"),  # these give NaN
    ("ppc_controller", {"rate_envelope.initial": 1e200}, r"initial = 1e\+200 rad/s; .*≤ 1e\+06"),
    ("ppc_controller", {"momentum_tube.a_most": 1e20}, r"a_most = 1e\+20 rad/s²; .*≤ 1e\+06"),
    ("ppc_controller", {"M_omega": 1e300}, r"M_omega = 1e\+300 rad/s; .*≤ 1e\+06"),
    ("ppc_controller", {"momentum_tube.brake": [1e-50] * 3}, r"brake = 1e-50 N·m; .*≥ 1e-09"),
    ("ppc_controller", {"momentum_tube.k": 5e-324}, r"momentum_tube.k = 5e-324 1/s; .*≥ 1e-09"),
    ("reference_generator", {"period_constant": [5e-324] * 3}, r"constant = 5e-324 s; .*≥ 0.01"),
    ("reference_generator", {"guidance.max_rate": 1e-9}, r"rate = 1e-09 rad/s; .*≥ 1e-05"),  # hangs
    ("reference_generator", {"guidance.max_acceleration": 1e-9}, r"1e-09 rad/s²; .*≥ 1e-07"),
    ("reference_generator", {"guidance.max_jerk": 1e-20}, r"jerk = 1e-20 rad/s³; .*≥ 1e-12"),
    ("thruster", {"a": 1}, "unknown node thruster"),
]


@pytest.mark.parametrize(("node", "values", "complaint"), BAD, ids=[bad[2][:40] for bad in BAD])
def test_bad_values_are_refused_with_one_clear_sentence(
    node: str, values: dict[str, Any], complaint: str
) -> None:
    with pytest.raises(ConfigurationError, match=complaint) as raised:
        scenario({node: values})
    assert "\n" not in str(raised.value)


AT_REST = {
    "spacecraft_plant": {"initial_attitude": [0.2, -0.5, -0.5, -0.6782]},
    "reference_generator": {"amplitude": [0.0] * 3},
    "disturbance_injector": {"environment": False},
}


@pytest.mark.parametrize("start", [{}, AT_REST], ids=["moving", "at_rest"])
@pytest.mark.parametrize("law", ["ppc", "log_barrier", "quaternion_feedback", "momentum_tube"])
def test_no_allowed_gain_makes_a_law_give_nan(law: str, start: dict[str, dict[str, Any]]) -> None:
    found = []
    for each in CONTROLLERS.components[law].parameters:
        least = math.nextafter(each.above, math.inf) if math.isfinite(each.above) else each.low
        for value in (least, each.high) if each.is_real else ():
            chosen = {"controller": law, each.name: [value] * each.length or value}
            with suppress(ConfigurationError):
                case = scenario({**start, "ppc_controller": chosen})
                samples = Diagram(case.parameters).run(STAMPS)
                found += [(each.name, value)] * bool(np.isnan(samples).any())
    assert not found


def test_only_the_selected_component_must_be_feasible() -> None:
    impossible = {"rate_envelope.exponential_terminal": 1e-6}
    case = scenario({"ppc_controller": {"controller": "quaternion_feedback", **impossible}})
    assert case.controller.name == "quaternion_feedback"
    with pytest.raises(ConfigurationError, match="rate_envelope is infeasible"):
        case.with_values("ppc_controller", controller="ppc")
    with pytest.raises(ConfigurationError, match="unknown node thruster; nodes are spacecraft"):
        case.with_values("thruster", a=1)


@pytest.mark.parametrize(("value", "name"), [(True, "paper"), (False, "none"), ("none", "none")])
def test_the_environment_is_switched_or_chosen(value: Any, name: str) -> None:
    case = scenario({"disturbance_injector": {"environment": value}})
    assert case.parameters["disturbance_injector"]["environment"] == name


def test_pulses_are_whole_nanoseconds() -> None:
    case = scenario(
        {
            "disturbance_injector": {
                "pulse_times": [20.1, 80],
                "pulse_durations": [0.1, 0.3],
                "pulse_torques": [1, 2, 3, 4, 5, 6],
            }
        }
    )
    found = scheduled_pulses(case.parameters["disturbance_injector"])
    assert found["start_ns"].tolist() == [20_100_000_000, 80_000_000_000]
    assert found["end_ns"].tolist() == [20_200_000_000, 80_300_000_000]
    assert found["torque"].tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]


def test_a_filter_that_hears_no_sensor_of_its_own_is_refused_for_that() -> None:
    """Not only because the numbers of a tracker that nobody wants are zero."""
    message = r"cross_noise = 0.*or reads gyro, which no .* gives; sensors = gyro_star_tracker wo"
    with pytest.raises(ConfigurationError, match=message):
        load(configs("paper"), {"attitude_estimator": {"estimator": "mekf"}})


def test_nodes_agree_on_when_a_fix_comes() -> None:
    files = configs("paper", "sensors_smallsat")
    message = "attitude_estimator: star_tracker.latency = 0.2; allowed: 0.1, as in spacecraft_plant"
    with pytest.raises(ConfigurationError, match=message):
        load(files, {"attitude_estimator": {"star_tracker.latency": 0.2}})
    assert load(files, {"attitude_estimator": {"star_tracker.cross_noise": 1e-4}})  # may be wrong


def test_nodes_agree_on_what_the_craft_is() -> None:
    files = configs("paper", "orbit")
    heavier = [3.0, 0.0, 0.0, 0.0, 2.5, 0.0, 0.0, 0.0, 1.9]
    message = (
        r"disturbance_injector: inertia = \[2.8.*; allowed: \[3.0.*, as in spacecraft_plant, "
        r"because nodes must agree \(under /\*\* a file sets it in all nodes\)"
    )
    with pytest.raises(ConfigurationError, match=message):
        load(files, {"spacecraft_plant": {"inertia": heavier}})
    assert load(files, {"ppc_controller": {"inertia": heavier}})  # the law may be wrong


@pytest.mark.parametrize(("start", "duration"), [(20.1, 0.01), (80.0, 1e-6), (0.507, 0.004)])
def test_a_pulse_that_acts_at_one_instant_is_allowed(start: float, duration: float) -> None:
    assert scenario(one_pulse(start, duration))


def test_the_least_duration_that_is_told_acts_wherever_it_begins() -> None:
    """Six digits of a third of a second are less than that."""
    at = {PLANT: {"rate": 3.0}}
    with pytest.raises(ConfigurationError) as refused:
        scenario({**at, **one_pulse(0.333333334, 0.33333333)})
    least = re.search(r"pulse_durations from (\S+) s on", str(refused.value))
    assert least
    assert scenario({**at, **one_pulse(0.333333334, float(least[1]))})


@pytest.mark.parametrize(("start", "duration"), [(0.503, 0.004), (20.1001, 0.0098)])
def test_a_pulse_that_would_never_act_is_refused(start: float, duration: float) -> None:
    message = rf"pulse from {start} to .* s lies between two instants of 100.0 Hz; allowed"
    for made in (scenario, scenario({}).overlaid):
        with pytest.raises(ConfigurationError, match=message):
            made(one_pulse(start, duration))


def one_pulse(start: float, duration: float) -> dict[str, dict[str, list[float]]]:
    return {"disturbance_injector": pulse(start, duration, 0.1, 0.1, 0.1)}


def test_nodes_refuse_to_wait_for_what_nobody_sends(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sensing is exact, so the plant does not send the truth beside it."""
    gradient = replace(paper_torque.COMPONENT, name="gradient", inputs=(TRUE_ATTITUDE,))
    monkeypatch.setitem(ENVIRONMENTS.components, "gradient", gradient)
    base = load(configs("paper"))
    check_exchange(base.parameters)
    injector = {**base.parameters["disturbance_injector"], "environment": "gradient"}
    case = {**base.parameters, "disturbance_injector": injector}
    with pytest.raises(ConfigurationError, match="read truth_attitude, which no node sends"):
        check_exchange(case)
    ahead = load(configs("paper", "guaranteed_ahead", "mission")).parameters
    with pytest.raises(ConfigurationError, match="no selected component gives; mode = paper_ahead"):
        check_exchange(ahead)
    other_words = replace(REFERENCE_ATTITUDE, meaning="where to point")
    monkeypatch.setitem(
        ENVIRONMENTS.components, "gradient", replace(gradient, inputs=(other_words,))
    )
    check_exchange(case)


def test_nodes_refuse_an_estimator_that_does_not_say_when_its_fixes_come(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The node would take the slots from parameters of another estimator, and wait for ever."""
    case = load(configs("paper", "sensors_smallsat"))
    monkeypatch.setitem(ESTIMATORS.components, "mekf", replace(mekf.COMPONENT, parameters=()))
    message = (
        "mekf reads star_fix, which comes late, and has no parameter star_tracker.rate, .*, which"
    )
    with pytest.raises(ConfigurationError, match=message):
        check_exchange(case.parameters)


def test_nodes_refuse_a_law_that_reads_what_comes_late(monkeypatch: pytest.MonkeyPatch) -> None:
    """The estimator alone knows when a fix is due: a law would wait for one at every instant."""
    law = replace(CONTROLLERS.components["ppc"], inputs=mekf.COMPONENT.inputs)
    monkeypatch.setitem(CONTROLLERS.components, "ppc", law)
    case = load(configs("paper", "sensors_smallsat"))
    with pytest.raises(ConfigurationError, match=r"controller: .* read star_fix, which comes l"):
        check_exchange(case.parameters)
