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

"""What a campaign may not declare: each refusal names the thing and what is allowed."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
from conftest import Ask
from craft_helpers import configs
from test_campaign_distributions import CRAFT, base

from ppc_attitude.campaign.declaration import campaign, draw, load_campaign, scenario_of_run
from ppc_attitude.contract.topics import ALLOCATOR, ESTIMATOR, INJECTOR, PLANT, REFERENCE
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.simulation.scenario import load


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("plant.inertia[0]", 1.0, "parameters has plant.inertia.0.; allowed: NODE.PARAMETER of sp"),
        (f"{PLANT}.rate", 1.0, "no real number of a component that runs"),
        (f"{PLANT}.seed", 1.0, "no real number of a component that runs"),
        (f"{PLANT}.rate_noise", 1.0, "no real number of a component that runs"),
        (f"{PLANT}.gyro.inital_bias[0]", 0.0, r"did you mean spacecraft_plant.gyro.initial_bias"),
        (f"{PLANT}.gyro.initial_bias", 0.0, r"initial_bias\[INDEX\], for it has 3 numbers"),
        (f"{PLANT}.gyro.initial_bias[3]", 0.0, r"for it has 3 numbers, from index 0"),
        (f"{PLANT}.max_torque[0]", 1.0, "max_torque is a single number"),
        (f"{PLANT}.max_torque", 0.0, "max_torque can become 0; allowed: finite, > 0"),
        (f"{PLANT}.inertia[0]", "wide", r"inertia\[0\] = 'wide'; allowed: finite"),
        (f"{PLANT}.initial_attitude", 0.1, "allowed: so3, cone"),
        (f"{PLANT}.initial_attitude[0]", 0.1, "one number of a quaternion; allowed: spacecraft_p"),
        (3, 1.0, "parameters has 3; allowed"),
    ],
)
def test_a_number_that_cannot_vary_is_refused_by_name(name: Any, given: Any, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        campaign({"parameters": {name: given}}, CRAFT, 0)


def test_an_estimator_waits_for_fixes_as_late_as_they_were_drawn() -> None:
    """Else a run that was drawn could not be flown by the nodes."""
    craft = load(configs("paper", "sensors_smallsat"))
    given = {
        "parameters": {
            f"{PLANT}.star_tracker.latency": {"distribution": "uniform", "low": 0.0, "high": 0.3}
        }
    }
    drawn = scenario_of_run(campaign(given, craft, 0), 0).parameters
    latency = drawn[PLANT]["star_tracker.latency"]
    assert latency == drawn[ESTIMATOR]["star_tracker.latency"] != 0.1
    given["parameters"][f"{ESTIMATOR}.star_tracker.latency"] = 0.2  # what a mismatch does
    drawn = scenario_of_run(campaign(given, craft, 0), 0).parameters
    assert drawn[ESTIMATOR]["star_tracker.latency"] == 0.2


def test_an_orbit_is_drawn_for_every_node_that_has_it() -> None:
    """Else the guidance would look for nadir on another orbit than the craft's."""
    altitude = {"distribution": "uniform", "low": 4e5, "high": 7e5}
    given = {"parameters": {f"{INJECTOR}.orbit.altitude": altitude}}
    drawn = scenario_of_run(campaign(given, load(configs("paper", "mission", "orbit")), 0), 0)
    assert len({drawn.parameters[node]["orbit.altitude"] for node in (INJECTOR, REFERENCE)}) == 1
    assert drawn.number(INJECTOR, "orbit.altitude") != 550e3


def test_one_number_varies_once() -> None:
    given = {"rate_noise": 1e-6, "parameters": {f"{PLANT}.rate_noise": 1e-6}}
    with pytest.raises(ConfigurationError, match="another name vary the same number"):
        campaign(given, base(), 0)


def test_a_noise_that_the_sensors_do_not_have_is_not_drawn(tmp_path: Path, ask: Ask) -> None:
    """One declaration serves every craft; what does nothing is not reported as drawn."""
    noise = {"attitude_noise": 1e-6, "rate_noise": 1e-7}
    paper, sensing = load(configs("paper")), load(configs("paper", "sensors_cubesat"))
    assert campaign(noise, paper, 0).variables.keys() >= noise.keys()
    assert not campaign(noise, sensing, 0).variables.keys() & noise.keys()
    with pytest.raises(ConfigurationError, match="rate_noise = 'much'; allowed"):
        campaign({"rate_noise": "much"}, sensing, 0)
    file = tmp_path / "noise.yaml"
    file.write_text(json.dumps({"campaign": noise}))
    given = [f"--config={each}" for each in configs("sensors_cubesat")]
    told, said = ask("campaign", "--campaign", file, "--only", 0, *given, "--duration", 1)
    assert "not drawn: attitude_noise, rate_noise; sensors = gyro_star_tracker has no such" in said
    assert "actuator_strength 1" in told
    assert "_noise" not in told.split("drawn: ")[1].splitlines()[0]


def test_every_node_with_noise_has_the_seed_of_the_run() -> None:
    """The magnetometer of an allocator is no sensor of the plant's."""
    case = ("paper", "wheels", "orbit", "unloading", "allocator_unloading")
    given = campaign({}, load(configs(*case)), 0)
    runs = [(scenario_of_run(given, k).parameters, draw(given, k)["noise_seed"]) for k in range(2)]
    assert [run[ALLOCATOR]["seed"] for run, _ in runs] == [seed for _, seed in runs]
    assert [run[PLANT]["seed"] for run, _ in runs] == [seed for _, seed in runs]
    assert runs[0][1] != runs[1][1]


def noise(kind: str, **numbers: Any) -> dict[str, Any]:
    return {"rate_noise": {"distribution": kind, **numbers}}


def hit(**numbers: float) -> dict[str, Any]:
    return {"disturbance": numbers}


def fault(what: Any, time: float = 1.0) -> dict[str, Any]:
    return {"fault": {"what": what, "time": time}}


def rate(direction: Any) -> dict[str, Any]:
    return {"initial_rate": {"magnitude": 0.1, "direction": direction}}


CONE = {"initial_attitude": {"distribution": "cone", "angle": 4}}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"inertia": 0.1}, "campaign has no inertia; allowed: initial_attitude"),
        (3, "campaign = 3; allowed: a mapping"),
        (
            {"parameters": {f"{PLANT}.max torque": 0.1}},
            "parameters has spacecraft_plant.max torque, which is no real number of a component",
        ),
        ({"parameters": 3}, "parameters = 3; allowed: a mapping of NODE.PARAMETER to distribution"),
        ({"rate_noise": "much"}, "rate_noise = 'much'; allowed: finite"),
        ({"rate_noise": True}, "rate_noise = True; allowed: finite"),
        ({"rate_noise": math.nan}, "rate_noise = nan; allowed: finite"),
        ({"rate_noise": -1e-6}, "rate_noise can become -1e-06; allowed: finite, ≥ 0"),
        (noise("gamma"), "rate_noise.distribution = 'gamma'; allowed"),
        (noise("uniform", low=0), "rate_noise lacks high"),
        (noise("uniform", low=0, high=1, mean=2), "has no mean; allowed: distribution, low, high"),
        (noise("uniform", low=0.5, high=0.1), "rate_noise.low = 0.5 is larger than high = 0.1"),
        (noise("log_uniform", low=0, high=1), "rate_noise.low = 0; allowed: > 0 for log_uniform"),
        (noise("normal", mean=0.1, deviation=0.1, low=-1), "rate_noise can become -1; allowed"),
        (noise("normal", mean=0, deviation=-1), "rate_noise.deviation = -1; allowed: > 0"),
        (noise("normal", mean=0, deviation=0.01, low=0.9), "only 0 .* lies between low = 0.9"),
        (noise("choice", values=[]), r"values = \[\]; allowed"),
        ({"inertia_error": 0.95}, "inertia_error can become 0.95; allowed: finite, ≥ 0, ≤ 0.9"),
        ({"actuator_strength": 0}, "actuator_strength can become 0; allowed: finite, > 0"),
        ({"actuator_strength": 1e-3}, "actuator_strength can become 0.001: .* min_torque"),
        ({"initial_attitude": "cube"}, "initial_attitude.distribution = 'cube'; allowed: so3"),
        (CONE, "initial_attitude.angle = 4 rad; allowed: 0 to π"),
        ({"initial_rate": 0.1}, "initial_rate = 0.1; allowed: a mapping of magnitude, direction"),
        ({"initial_rate": {}}, "initial_rate.magnitude = None; allowed: finite"),
        (
            rate([0, 0, 0]),
            r"initial_rate.direction has \[0.0, 0.0, 0.0\], which is no direction",
        ),
        (rate("up"), "initial_rate.direction = 'up'; allowed: sphere, or three numbers"),
        (hit(time=11, duration=1, torque=1), "time can become 11; allowed: finite, ≥ 0, ≤ 10 s"),
        (hit(time=1, duration=0, torque=1), "duration can become 0; .* ≥ 0.01, ≤ 10 s"),
        (hit(time=1, duration=1), "disturbance.torque = None; allowed"),
        (fault("x"), "fault.what = 'x'; allowed: a list of faults"),
        (fault(["actuator/x stuck 0"], time=11), "fault.time can become 11; allowed"),
        (fault(["wheel/0 seized"]), "fault.what: .* has a part wheel/0"),
        (fault(["actuator/x dead"]), "fault.what: .* has no fault dead"),
    ],
)
def test_refusals_name_the_thing_its_value_and_what_is_allowed(given: Any, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        campaign(given, base(), 0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("campaign: [", "cannot be read as YAML"),
        ("- 1", "allowed: one key at its top, campaign"),
        ("campaign: {}\nother: 1", "allowed: one key at its top, campaign"),
        ("campaign: {rate_noise: x}", "campaign.yaml: rate_noise = 'x'"),
    ],
)
def test_a_bad_file_is_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "campaign.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=message):
        load_campaign(path, base(), 0)


def test_a_number_of_a_file_needs_no_point_before_its_exponent(tmp_path: Path) -> None:
    path = tmp_path / "campaign.yaml"
    path.write_text("campaign: {rate_noise: 1e-7, inertia_error: 1E-1}", encoding="utf-8")
    drawn = draw(load_campaign(path, base(), 0), 0)
    assert (drawn["rate_noise"], drawn["inertia_error"]) == (1e-7, 0.1)
