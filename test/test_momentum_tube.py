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
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from craft_helpers import configs, guaranteed, pulse
from record_helpers import configured, inputs_of, outputs_of, settled_after, state_of
from scipy.spatial.transform import Rotation

from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import CONTROLLER
from ppc_attitude.science.component import QUATERNION
from ppc_attitude.science.controllers import momentum_tube, tube_parameters
from ppc_attitude.science.controllers.brake import deceleration
from ppc_attitude.science.controllers.momentum_tube import _advance
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.guarantee.assumptions import parameters_of
from ppc_attitude.science.guarantee.cells import COARSE
from ppc_attitude.science.guarantee.fixed_point import tuned
from ppc_attitude.science.kernel import matrix
from ppc_attitude.science.kinds import CONTROLLERS
from ppc_attitude.science.stamps import seconds
from ppc_attitude.simulation.closed_loop import simulate, stamps_of
from ppc_attitude.simulation.diagram import Diagram
from ppc_attitude.simulation.scenario import load, scenario

LAW = {"controller": "momentum_tube"}


def run(duration: float = 120.0, **nodes: dict[str, Any]) -> RunRecord:
    return simulate(scenario({"ppc_controller": LAW} | nodes), duration)


def told_after(seconds: float, **nodes: dict[str, Any]) -> str:
    diagram = Diagram(scenario({"ppc_controller": LAW} | nodes).parameters)
    diagram.run(stamps_of(100.0, seconds))
    return diagram.parts[CONTROLLERS.name].advice.text


def inside(record: RunRecord) -> bool:
    return bool(
        (np.abs(record["attitude_error"][:, :3]) <= record["attitude_envelope"]).all()
        and (np.abs(record["momentum_error"]) <= record["momentum_tube"]).all()
    )


# The numbers that an independent implementation of the law ran with, about every axis the same.
REFERENCE = {
    "momentum_tube.k": 1.0,
    "momentum_tube.ell": 0.2,
    "momentum_tube.B_ramp": 0.0,
    "momentum_tube.brake": [0.05, 0.05, 0.05],
    "momentum_tube.a_most": 0.0127476693,
    "momentum_tube.Omega_e": 0.0514351379,
    "momentum_tube.Y": [1.29068353e-3, 1.25668278e-3, 1.18651711e-3],
    "momentum_tube.B": [0.0428397211, 0.0431208910, 0.0437035157],
    "momentum_tube.z_bar": 9.247386e-4,
    "momentum_tube.V_rate": 1.35e-3,
    "momentum_tube.far": 0.699525426,
    "momentum_tube.w_far": 0.0349,
    "momentum_tube.omega0": 0.104719755,
}


def test_papers_case_settles_at_the_reference_numbers() -> None:
    """17.13 s, 1.4e-6 in the last 20 s, 2.948 deg/s: of that implementation."""
    record = run(ppc_controller=LAW | REFERENCE)
    error = np.abs(record["attitude_error"][:, :3]).max(axis=1)
    rate = np.degrees(np.linalg.norm(record["angular_velocity"], axis=1))
    assert settled_after(record) == pytest.approx(17.13, abs=0.02)
    assert error[record.t > 100.0].max() == pytest.approx(1.4e-6, rel=0.02)
    assert rate.max() == pytest.approx(2.948, abs=1e-3)
    assert np.abs(record["applied_torque"]).max() <= 0.05
    assert inside(record)


@pytest.mark.parametrize(("duration", "recovery"), [(0.1, 4.12), (0.2, 9.98), (0.5, 37.1)])
def test_recovers_from_a_hit_as_the_reference_does(duration: float, recovery: float) -> None:
    hit = pulse(80.0, duration, 0.8, 0.8, 0.8)
    record = run(160.0, disturbance_injector=hit, ppc_controller=LAW | REFERENCE)
    assert settled_after(record, 80.0) == pytest.approx(recovery, abs=0.02)


def test_recovers_from_the_papers_hit_as_soon_as_the_papers_law() -> None:
    """3.57 s is what that law needs; without more torque for the ramps it would be 3.9 s."""
    case = {"disturbance_injector": pulse(80.0, 0.1, 0.8, 0.8, 0.8)}
    record = run(90.0, **case)
    assert settled_after(record, 80.0) <= 3.57
    assert (np.abs(record["momentum_error"]) / record["momentum_tube"]).max() < 0.5
    careful = run(90.0, **case, ppc_controller=LAW | {"momentum_tube.B_ramp": 0.0})
    assert settled_after(careful, 80.0) > 3.8


def test_ramps_use_no_more_than_B_from_half_the_tube_on() -> None:
    memory, gains = state_of(momentum_tube.COMPONENT), law_of()
    for share, more in ((0.0, 1.0), (0.25, 1.0), (0.375, 0.5), (0.5, 0.0), (1.0, 0.0)):
        allowed = momentum_tube.ramp_torque(memory, gains, tuple(-share * gains["Y"]))
        expected = gains["B"] + more * (gains["B_ramp"] - gains["B"])
        assert allowed == pytest.approx(tuple(expected), rel=1e-12)


def test_the_envelope_allows_in_a_short_sample_for_what_a_whole_one_may_be_wrong() -> None:
    """V_rate has the error of the attitude by the certificate's sample: half was missing."""
    memory, gains = state_of(momentum_tube.COMPONENT), law_of(V_rate=0.1)
    h = float(gains["h"])
    memory["envelope"], memory["cap"], memory["a"], memory["r"] = 3.0, 0.04, 0.01, 1.0
    _advance(memory, gains, 0.5 * h)
    expected = 3.0 + 0.5 * h * (gains["z_bar"] - (0.04 - 0.1 * h))
    assert memory["envelope"] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("left", [1.0, 1e-6])
@pytest.mark.parametrize(
    ("p", "done", "f"), [(1.0, 0.0, 0.1), (0.0, 0.0, 0.1), (0.0, 1.0, 0.1), (0.0, 1.0, 0.01)]
)
def test_a_ramp_moves_as_fast_as_the_torque_allows_or_ends(
    p: float, done: float, f: float, left: float
) -> None:
    """And F has just the torque that its rate needs: −J v' of v = p ω_res − r f n."""
    memory, gains = state_of(momentum_tube.COMPONENT), law_of()
    J, n, f_cap, cap = np.array(gains["inertia"]), np.array([0.6, -0.64, 0.48]), 0.7, 2.0
    residual, before = np.array([0.03, 0.05, -0.02]), np.array([0.01, -0.02, 0.005])
    memory["residual"], memory["p"], memory["done"] = residual, p * left, done
    memory["sigma"], memory["r"] = cap - left, 1.0 - left
    given = (matrix(J), tuple(n), (f, f_cap, cap), (0.0, 0.0, 0.0))
    after = np.array(momentum_tube._allocated(memory, gains, tuple(before), *given))
    rates = np.array([memory[name] for name in ("p_rate", "sigma_rate", "r_rate")])
    needed = J @ np.outer(residual, [-1, 0, 0]) + J @ np.outer(n, [0, f_cap, f])
    assert after == pytest.approx(before + needed @ rates, rel=1e-12)
    most = np.maximum(gains["B"], gains["B_ramp"])
    if left < 1.0:
        assert np.abs(rates).max() == pytest.approx(left / gains["h"], rel=1e-6)
    elif f == 0.01:  # r falls no faster than the brake
        assert rates[2] == gains["k"]
    else:
        assert np.abs(after / most).max() == pytest.approx(1.0, rel=1e-12)


def test_the_disturbance_estimate_is_bounded_and_follows_what_is_unexplained() -> None:
    memory, gains = state_of(momentum_tube.COMPONENT), law_of()
    most = np.array(gains["d_max"]) * np.ones(3)
    unexplained = (2.0 * most[0], 1e6, -1e6)
    momentum_tube._observe(memory, gains, (0.0, 0.0, 0.0), unexplained, 0.01)
    assert memory["d_hat"] == pytest.approx((0.02 * most[0], most[1], -most[2]), rel=1e-12)


def test_recovers_when_a_hit_makes_the_craft_tumble() -> None:
    record = run(140.0, disturbance_injector=pulse(80.0, 1.0, 0.8, 0.8, 0.8))
    assert settled_after(record, 80.0) < 48.0
    tumbling = record["attitude_envelope"][:, 0] == 1.0
    assert tumbling.any()
    assert inside(record)
    memory, command = new_records()
    gains = law_of()
    memory["numbers"], memory["tumbling"], memory["y"] = gains["numbers"], 1.0, 1e-3
    turning = measurement_of(Rotation.identity(), (1.0, 0.0, 0.0))
    momentum_tube.step(turning, memory, gains, command)
    assert (memory["tumbling"], *command["momentum_error"]) == (1.0, 0.0, 0.0, 0.0)  # none is told
    assert momentum_tube.advice(memory).text == "nothing is guaranteed while the craft tumbles"


def law_of(**values: Any) -> Any:
    given = {tube_parameters.PREFIX + name: value for name, value in values.items()}
    return configured(momentum_tube.COMPONENT, given)


def new_records() -> tuple[Any, Any]:
    return state_of(momentum_tube.COMPONENT), outputs_of(momentum_tube.COMPONENT)


def measurement_of(error: Rotation, rate: Any) -> Any:
    measurement = inputs_of(momentum_tube.COMPONENT)
    measurement["attitude"] = error.as_quat()
    measurement["angular_velocity"] = rate
    measurement["reference_attitude"] = (0.0, 0.0, 0.0, 1.0)
    return measurement


@pytest.mark.parametrize("angle", [0.0, 0.01, 0.3, 2.0, math.pi])
@pytest.mark.parametrize("speed", [0.0, 0.01, -0.03, -0.1])
def test_an_event_forgives_the_momentum_error(angle: float, speed: float) -> None:
    measurement = measurement_of(
        Rotation.from_rotvec(angle * np.array([0.6, -0.64, 0.48])), speed * np.array([0.8, 0.6, 0])
    )
    memory, command = new_records()
    gains = law_of()
    momentum_tube.step(measurement, memory, gains, command)
    assert memory["events"] == 1
    useful = max(-0.096 * speed, 0.0) if angle else 0.0  # −n·ω
    waits = angle < gains["far"] or abs(speed) > gains["w_far"]
    expected = (0.0, 1.0, 0.0) if waits else (1.0, 0.0, useful)
    assert [memory[name] for name in ("r", "done", "sigma")] == pytest.approx(expected, abs=1e-12)
    assert np.all(command["momentum_error"] == 0.0)
    assert memory["envelope"] == pytest.approx(angle, abs=1e-7)
    assert command["attitude_envelope"] == pytest.approx(np.sin(angle / 2), abs=1e-7)


def test_a_quaternion_and_its_negative_are_the_same_attitude() -> None:
    """Who keeps the scalar part positive changes the sign in flight: each time was a new event."""
    record = run(20.0)
    random = np.random.default_rng(7)
    memory, command = new_records()
    gains, measurement = law_of(), inputs_of(momentum_tube.COMPONENT)
    for k, stamp_ns in enumerate(record.stamps_ns.tolist()):
        measurement["t"] = seconds(stamp_ns)
        for column in momentum_tube.COMPONENT.inputs:
            sign = random.choice([-1.0, 1.0]) if column.form == QUATERNION else 1.0
            measurement[column.name] = sign * record[column.name][k]
        momentum_tube.step(measurement, memory, gains, command)
        assert np.array_equal(command["torque_command"], record["torque_command"][k])
    assert memory["events"] == 1


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("seed", range(30))
def test_feedforward_is_what_the_commanded_rate_needs(seed: int, way: float) -> None:
    """y' = F + τ + d, here of a craft that nothing turns, with all ramps at their ends."""
    random, gains = np.random.default_rng(seed), law_of()
    J, desired = np.array(gains["inertia"]), Rotation.random(random_state=random)
    axis, angle = random.normal(size=3), 10.0 ** random.uniform(-2.0, 0.4)
    error = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
    omega, omega_d, acceleration_d = random.uniform(-0.02, 0.02, (3, 3))
    acceleration = -np.linalg.solve(J, np.cross(omega, J @ omega))

    def told_at(t: float) -> Any:
        measurement = measurement_of(
            desired * error * Rotation.from_rotvec(t * omega + 0.5 * t * t * acceleration),
            omega + t * acceleration,
        )
        turned = Rotation.from_rotvec(t * omega_d + 0.5 * t * t * acceleration_d)
        measurement["reference_attitude"] = (desired * turned).as_quat()
        measurement["reference_angular_velocity"] = omega_d + t * acceleration_d
        measurement["reference_angular_acceleration"] = acceleration_d
        memory, command = new_records()
        memory["numbers"], memory["r"], memory["done"] = gains["numbers"], 1.0, 1.0
        memory["error"], memory["way"] = way * error.as_quat(canonical=True), way
        momentum_tube.step(measurement, memory, gains, command)
        assert memory["events"] == 0
        return memory

    changed = (told_at(1e-4)["y"] - told_at(-1e-4)["y"]) / 2e-4
    assert told_at(0.0)["feedforward"] == pytest.approx(changed, abs=1e-6)


@pytest.mark.parametrize(
    ("plant", "duration", "settled"),
    [
        ({"max_torque": 0.04}, 200.0, 90.0),
        ({"max_torque": 0.03}, 200.0, 90.0),
        ({"initial_angular_velocity": [0.3, -0.2, 0.25]}, 150.0, 140.0),  # 25 deg/s: it tumbles
    ],
)
def test_no_start_makes_a_cycle_of_events(
    plant: dict[str, Any], duration: float, settled: float
) -> None:
    """Outside its assumptions the law counts on less torque instead of beginning for ever anew."""
    for attitude in Rotation.random(6, random_state=np.random.default_rng(5)).as_quat():
        craft = {**plant, "initial_attitude": attitude.tolist()}
        record = run(duration, spacecraft_plant=craft)
        assert settled_after(record) < settled
        assert record["phase"][-1, 1] <= 6
        assert inside(record) or "max_torque" in plant


def test_torque_that_was_short_twice_is_not_counted_on_and_said() -> None:
    memory, command = new_records()
    memory["events"], memory["slips"], memory["loss"] = 3.0, 2.0, 0.2
    told = momentum_tube.advice(memory)
    assert told.warning
    assert told.text.startswith(
        "the guarantee is suspended: the actuator gave too little torque 2 times, "
    )
    gains, error = law_of(), Rotation.from_rotvec([1.2, 0.0, 0.0])
    momentum_tube.step(measurement_of(error, (0.0, 0.0, 0.0)), memory, gains, command)
    torque = (1.0 - 0.2 / 0.85) * gains["brake"]  # 15 % of the torque is not the brake's anyway
    n, still = (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    expected = deceleration(n, still, matrix(gains["inertia"]), tuple(torque), gains["a_most"])[0]
    assert memory["a"] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("told", "nodes"),
    [
        ("the guarantee is suspended: the measurement", {"spacecraft_plant": {"rate_noise": 5e-5}}),
        ("the guarantee is suspended: commands act", {"spacecraft_plant": {"late_command": True}}),
        (
            "the guarantee is suspended: the actuator gave",
            {"spacecraft_plant": {"max_torque": 0.03}},
        ),
        (
            "the guarantee is suspended: the craft",
            {"spacecraft_plant": {"inertia": [3.6, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.4]}},
        ),
        (
            "the guarantee is suspended: a disturbance",
            {"disturbance_injector": pulse(0.0, 100.0, 5e-3, 5e-3, 5e-3)},
        ),
        ("nothing is guaranteed: no certificate", {}),
    ],
)
def test_an_assumption_that_is_seen_broken_is_named(
    told: str, nodes: dict[str, dict[str, Any]]
) -> None:
    """From what the law itself measures: it is not told what the craft is really like."""
    found = {told_after(time, **nodes)[: len(told)] for time in (0.5, 1.0, 1.5, 5.0)}
    assert told in found
    assert bool(nodes) == any("suspended" in each for each in found)


def test_an_estimate_at_its_limit_is_no_proof_of_a_broken_assumption() -> None:
    """The dead band alone may hold it there, and the guarantee was said to be suspended."""
    assumed = replace(guaranteed()[0], d=5e-5)  # half the dead band
    law = tuned(assumed, 0.01, (1.0, 15.4, 0.2), COARSE)
    push = pulse(0.0, 20.0, 5e-5, 5e-5, 5e-5)
    told = told_after(
        20.0,
        disturbance_injector={"environment": False, **push},
        ppc_controller=LAW | parameters_of(assumed, law),
    )
    assert told.startswith("the guarantee may be suspended: the disturbance estimate stays")


def test_where_the_speed_reaches_its_limit_no_assumption_is_said_to_be_broken() -> None:
    """The jump of y there, which C1 allows for, was taken for a torque that nobody assumed."""
    assumed = replace(guaranteed()[0], d=1e-4, W1=3.5e-3, W2=9e-4)
    law = tuned(assumed, 0.01, (1.0, 15.4, 0.2), COARSE)
    told = told_after(
        5.0,
        spacecraft_plant={"initial_attitude": [0.0, -math.sin(1.2), 0.0, math.cos(1.2)]},
        reference_generator={
            "initial_attitude": [0.0, 0.0, 0.0, 1.0],
            "amplitude": [0.0, 0.0139, 0.0],
            "period_constant": [4.0, 4.0, 4.0],
        },
        disturbance_injector={"environment": False},
        ppc_controller=LAW | parameters_of(assumed, law),
    )
    assert told.startswith("nothing is guaranteed: no cert")


def test_other_numbers_in_flight_begin_a_new_promise() -> None:
    """Another set led out of its tube, and without a certificate the old promise still stood."""
    turned = {"spacecraft_plant": {"initial_attitude": [0.707, 0.0, 0.0, 0.707]}}
    quiet, sharp = (
        load(configs("paper", each), turned).parameters
        for each in ("guaranteed_quiet", "guaranteed_sharp")
    )
    diagram, stamps = Diagram(quiet), stamps_of(100.0, 2.0)
    part = diagram.parts[CONTROLLERS.name]
    diagram.run(stamps[:100])
    changed = (
        (sharp[CONTROLLER], "the guarantee applies from"),
        (sharp[CONTROLLER] | {"momentum_tube.k": 1.2}, "nothing is guaranteed: its certificate is"),
    )
    for k, (values, told) in enumerate(changed):
        before = part.advices
        part.configure(values)
        diagram.run(stamps[100 + k : 101 + k])
        assert part.advices == before + 1
        assert part.advice.text.startswith(told)
        assert part.normalised_errors()["momentum_tube"] <= 1.0


def test_noise_far_beyond_the_assumed_one_makes_no_cycle_of_events() -> None:
    """As after a small satellite's filter: a hit in every sample, were it taken for hits."""
    record = run(100.0, spacecraft_plant={"rate_noise": 5e-4})
    assert settled_after(record) < 30.0
    assert record["phase"][-1, 1] <= 4


def test_an_impossible_torque_is_refused() -> None:
    for name, value in (("B", [0.06, 0.04, 0.04]), ("brake", [0.06, 0.04, 0.04]), ("B_ramp", 0.06)):
        told = rf"momentum_tube.{name} = .*at most max_torque"
        with pytest.raises(ConfigurationError, match=told):
            scenario({"ppc_controller": {**LAW, f"momentum_tube.{name}": value}})
