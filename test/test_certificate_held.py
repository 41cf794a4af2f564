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

"""The row of the verdict that says whether a certificate held."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Ask, coarse_cells
from craft_helpers import case, configs, overlay
from scipy.spatial.transform import Rotation
from synthetic import requirement, with_columns, with_parameters, with_rows, without_columns

from ppc_attitude.analysis.guarantee import Held, certificate_held, nodes_around
from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.command_line.main import main
from ppc_attitude.contract.run_record import Array, Change, RunRecord
from ppc_attitude.contract.topics import (
    CONTROLLER,
    INJECTOR,
    PLANT,
    REFERENCE,
    REFERENCE_ACCELERATION,
    REFERENCE_ATTITUDE,
    REFERENCE_RATE,
)
from ppc_attitude.science.guarantee import design
from ppc_attitude.science.guarantee.assumptions import assumptions_of, law_of
from ppc_attitude.science.guarantee.fixed_point import TUMBLING
from ppc_attitude.science.guarantee.surroundings import _rate_lag
from ppc_attitude.simulation.closed_loop import Loop, simulate, stamps_of
from ppc_attitude.simulation.diagram import Diagram
from ppc_attitude.simulation.scenario import load

pytestmark = pytest.mark.usefixtures("coarse")
FLAGSHIP = [f"--config={file}" for file in configs("paper", "sensors_flagship")]
GAINS = ("0.56", "28", "0.392")  # for the sensors of a flagship


def record_of(*overlays: str, **nodes: dict[str, Any]) -> RunRecord:
    return simulate(load(configs("paper", *overlays), nodes), 25.0)


def held_by(record: RunRecord) -> Held:
    held = certificate_held(record)
    assert held is not None
    return held


def test_a_run_within_the_assumptions_holds() -> None:
    held = held_by(record_of("guaranteed"))
    assert (held.reason, held.note, held.outside.any()) == ("", "", False)


def test_of_a_run_whose_samples_are_all_late_nothing_is_judged() -> None:
    """As with a driver at half the rate; the first instant, which has no step, counted as kept."""
    whole = record_of("guaranteed")
    halved = replace(
        whole,
        stamps_ns=whole.stamps_ns[::2],
        columns={name: rows[::2] for name, rows in whole.columns.items()},
    )
    held = held_by(halved)
    assert held.reason == f"suspended: a late sample at {halved.stamps_ns.size - 1} instants"


@pytest.mark.parametrize("column", ["attitude", "momentum_error", "phase"])
def test_a_promise_is_not_judged_where_a_column_is_long_not_on_record(column: str) -> None:
    run = with_rows(record_of("guaranteed"), column, slice(100, 1000), np.nan)
    row = requirement(Verdict(run), "certificate")
    assert (row.met, row.reason) == (None, "nothing is on record from 0.99 to 10 s")


def test_a_hit_suspends_the_promise_and_says_so() -> None:
    held = held_by(record_of("guaranteed", "sudden_disturbance"))
    assert not held.outside.any()
    assert held.note == "suspended: a disturbance beyond the assumed one at 10 instants"


@pytest.fixture(scope="module")
def designed(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """Overlays of a craft with gyro, star tracker and filter, and of the law proved for it."""
    path = tmp_path_factory.mktemp("design") / "flagship.yaml"
    with coarse_cells():
        given = ["--gains", *GAINS, "--rate", "5", "--out", str(path)]  # its sensors go so far
        assert main(["design", *FLAGSHIP, *given]) == 0
    return "sensors_flagship", str(path.with_suffix(""))


def test_a_design_knows_the_errors_of_its_sensors(designed: tuple[str, str]) -> None:
    record = record_of(*designed)
    held = held_by(record)
    assert (held.reason, held.note, held.outside.any()) == ("", "", False)
    values = record.parameters[CONTROLLER]
    off = np.linalg.norm(record["angular_velocity"] - record["truth_angular_velocity"], axis=1)
    # A gyro's mean rate lags by half a step: while the craft speeds up, by most of the bound.
    assert 0.3 < off.max() / values["momentum_tube.assumed.e_W"] < 1.0


@pytest.mark.parametrize(
    ("plant", "reason"),
    [
        ({"gyro.full_scale": 0.03}, "gyro.full_scale = 0.03 rad/s; the promised rates"),
        ({"gyro.initial_bias": [2e-7, 0.0, 0.0]}, ""),
        (
            # The estimate was five times worse than assumed.
            {"gyro.initial_bias": [1e-3, 0.0, 0.0]},
            "gyro.initial_bias = [0.001, 0.0, 0.0] rad/s; the filter takes σ = 2.42407e-07",
        ),
    ],
)
def test_a_gyro_that_is_not_as_the_filter_takes_it_voids_the_promise(
    designed: tuple[str, str], plant: dict[str, Any], reason: str
) -> None:
    held = held_by(record_of(*designed, spacecraft_plant=plant))
    assert held.reason.startswith(reason)
    assert bool(held.reason) == bool(reason)


def test_check_says_that_a_promise_needs_fixes(
    designed: tuple[str, str], tmp_path: Path, ask: Ask
) -> None:
    tracker = {"blinding_times": [30.0], "blinding_durations": [5.0], "dropout_probability": 1.0}
    late = {"/**": {"initial_fix": False}}
    blind = overlay(tmp_path / "blind.yaml", {**late, PLANT: {"star_tracker": tracker}})
    files = [f"--config={file}" for file in (*configs(designed[1]), blind)]
    told = ask("check", *FLAGSHIP, *files).page
    assert "guaranteed: |q_ev,i| < " in told
    for found in (
        "max_rate = 0.06981 rad/s is below the promised 0.1",
        "blinding_times = [30.0] removes",
        "dropout_probability = 1.0 removes",
    ):
        assert f"warning: the promise holds while fixes come: star_tracker.{found}" in told
    assert "warning: no fix comes before 0.1 s (initial_fix = false): the promised times" in told
    told = ask("check", *FLAGSHIP, files[0], "--hit", 3.0, 0.02, code=2).err
    assert "the gyro gives the mean rate of a step, which a hit makes lag by more than e_W" in told
    refused = ask("check", *FLAGSHIP, *files, "--known-reference", code=2)
    assert "initial_fix = false; allowed with --known-reference: true" in refused.err


def test_a_design_knows_the_torque_noise_that_its_sensors_make(
    designed: tuple[str, str], ask: Ask, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = configs("paper", *designed)
    law = law_of(load(files).parameters[CONTROLLER])
    monkeypatch.setattr(design, "tuned", lambda *_: law)  # of these gains, found before
    told = ask("design", *FLAGSHIP, "--gains", *GAINS, "--torque-noise", 1e-6, code=1).out
    found = re.search(r"nearest that was found is (\S+) N·m", told)
    assert found
    torque = simulate(load(files), 60.0)["torque_command"][-3000:]
    slow = np.apply_along_axis(np.convolve, 0, torque, np.full(101, 1 / 101), "valid")
    noise = np.sqrt(np.mean((torque[50:-50] - slow) ** 2, axis=0))
    assert float(found[1]) == pytest.approx(noise.max(), rel=0.15)


@pytest.mark.parametrize(
    ("e_S", "products"),  # [1], [kg·m²]
    [
        (0.0, 0.0),
        (0.1, 0.3),
        pytest.param(0.0, 0.3, marks=pytest.mark.long),
        pytest.param(0.1, 0.0, marks=pytest.mark.long),
    ],
)
def test_no_craft_within_the_assumptions_lags_more_than_a_gyro_may(
    e_S: float, products: float
) -> None:
    known = np.diag([2.8, 2.5, 1.9]) + products * (np.ones((3, 3)) - np.eye(3))
    nodes = nodes_around(case("sensors_flagship").parameters)
    told = assumptions_of(load(configs("guaranteed")).parameters[CONTROLLER])
    assumed = replace(told, inertia=tuple(known.ravel().tolist()), e_S=e_S)
    moments, axes = np.linalg.eigh(known)
    root = axes * np.sqrt(moments) @ axes.T
    random, most = np.random.default_rng(5), 0.0
    fastest = TUMBLING[0] * assumed.Omega
    for _ in range(2000):
        S = random.normal(size=(3, 3))
        S = e_S * (S + S.T) / np.linalg.norm(S + S.T, 2)
        inertia = root @ (np.eye(3) + S) @ root
        omega = random.normal(size=3)
        omega *= fastest / np.linalg.norm(omega)
        torque = (assumed.max_torque + assumed.d) * random.choice([-1.0, 1.0], 3)
        change = np.linalg.solve(inertia, torque - np.cross(omega, inertia @ omega))
        most = max(most, 0.5 * 0.01 * float(np.linalg.norm(change)))
    assert (0.9 if e_S == 0.0 else 0.8) < most / _rate_lag(nodes, assumed, fastest) < 1.0


def test_a_tracker_that_is_blind_suspends_the_promise(designed: tuple[str, str]) -> None:
    blind = {"star_tracker.blinding_times": [0.05], "star_tracker.blinding_durations": [300.0]}
    record = simulate(load(configs("paper", *designed), {PLANT: blind}), 300.0)
    assert "or one whose covariance is beyond the assumed errors" in held_by(record).note


@pytest.mark.parametrize(
    ("column", "share", "assumed", "told"),
    [
        ("reference_angular_velocity", 1.001, "W", "faster than assumed at 10 instants"),
        ("reference_angular_acceleration", 1.001, "W1", "harder than assumed at 11 instants"),
        # It jumps there and back: only the change is beyond its bound.
        ("reference_angular_acceleration", 0.999, "W1", "harder than assumed at 2 instants"),
    ],
)
def test_a_reference_beyond_the_assumed_bounds_suspends_the_promise(
    column: str, share: float, assumed: str, told: str
) -> None:
    record = record_of("guaranteed")
    bound = record.parameters[CONTROLLER][f"momentum_tube.assumed.{assumed}"]
    motion = record[column].copy()
    motion[2000:2010] = (share * bound, 0.0, 0.0)
    assert told in held_by(with_columns(record, **{column: motion})).note
    assert told not in held_by(record).note


def with_inputs(changed: dict[str, Array]) -> RunRecord:
    """Run the shipped certificate with other numbers of what depends on time alone."""
    scenario = load(configs("paper", "guaranteed"))
    stamps = stamps_of(100.0, 25.0)
    table = Diagram(scenario.parameters, ahead=True)
    samples, first = table.run(stamps), 0
    for column in table.columns:
        if column.name in changed:
            samples[first : first + column.width] = changed[column.name].T
        first += column.width
    return Loop(scenario, stamps, samples).run(scenario)


def test_a_reference_that_tells_another_rate_than_it_has_suspends_the_promise() -> None:
    """Each of its numbers is within its bound; the certificate was blamed all the same."""
    rate = REFERENCE_RATE.column
    told = record_of("guaranteed")[rate].copy()
    told[2000:] *= 0.5
    held = held_by(with_inputs({rate: told}))
    assert not held.outside.any()
    assert held.note == (
        "suspended: a reference attitude that contradicts its rate at 501 instants, "
        "a reference whose rate jumps at 501 instants"
    )


def test_a_reference_that_steps_suspends_the_promise() -> None:
    desired = record_of("guaranteed")[REFERENCE_ATTITUDE.column].copy()
    desired[2000:2002] = desired[1999]
    note = held_by(with_inputs({REFERENCE_ATTITUDE.column: desired})).note
    assert note == "suspended: a reference attitude that contradicts its rate at 3 instants"


def test_what_a_torque_led_out_of_the_tube_is_suspended_until_it_is_back() -> None:
    """It was blamed on the certificate from the second sample after the torque on."""
    torque = np.full((2501, 3), -4.37e-3)
    torque[1500:1520], torque[1520:1540], torque[1540:] = -0.0195, 0.0195, 4.37e-3
    record = with_inputs({"environment_torque": torque})
    held = held_by(record)
    left = (np.abs(record["momentum_error"]) > record["momentum_tube"]).any(axis=1)
    assert left[1545]
    assert held.note == (
        "suspended: a disturbance beyond the assumed one at 40 instants, "
        f"not yet back within the bounds at {np.count_nonzero(left[1542:])} instants"
    )
    assert not held.outside.any()
    # From then on the promise counts again.
    error = record["momentum_error"].copy()
    error[1600] = 2.0 * record["momentum_tube"][1600]
    outside = held_by(with_columns(record, momentum_error=error)).outside
    assert np.flatnonzero(outside).tolist() == [1600]


def test_a_changed_number_is_not_judged() -> None:
    record = record_of("guaranteed", ppc_controller={"momentum_tube.kappa": 15.1})
    row = requirement(Verdict(record), "certificate")
    assert (row.met, row.reason) == (None, "the certificate is for other parameter values")


@pytest.mark.parametrize(
    ("node", "name", "value", "told"),
    [
        (CONTROLLER, "momentum_tube.kappa", 15.1, "the certificate is for other parameter values"),
        (CONTROLLER, "enabled", False, "the law was switched off"),
        (PLANT, "max_torque", 0.03, "max_torque = 0.03 N·m; assumed: at least 0.05"),
        (REFERENCE, "amplitude", [0.1, 0.1, 0.1], ""),  # its motion is on record
        (PLANT, "real_time_factor", 2.0, ""),  # which no assumption is about
    ],
)
def test_what_was_changed_in_flight_is_compared_as_well(
    node: str, name: str, value: Any, told: str
) -> None:
    changes = (Change(10**10, node, name, value), Change(2 * 10**10, PLANT, "seed", 1))
    held = held_by(replace(record_of("guaranteed"), changes=changes))
    assert held.reason.startswith(told)
    assert bool(held.reason) is bool(told)


def test_a_run_with_two_certificates_is_judged_by_neither() -> None:
    """It was judged by the bounds of the first, and the second was blamed for them."""
    record, other = record_of("guaranteed"), load(configs("guaranteed_sharp"))
    new = other.parameters[CONTROLLER].items()
    changes = tuple(Change(10**10, CONTROLLER, *each) for each in new)
    assert held_by(replace(record, changes=changes)).reason == (
        "the certificate was replaced in flight"
    )


@pytest.mark.parametrize(
    ("plant", "reason"),
    [
        ({}, ""),  # a bag that does not tell: nothing is known to be broken
        ({"rate": 1e2, "inertia": [2.8, 0, 0, 0, 2.5, 0, 0, 0, 1.9]}, "lacks the parameter"),
    ],
)
def test_a_plant_of_others_may_tell_little_of_itself(plant: dict[str, Any], reason: str) -> None:
    record = record_of("guaranteed")
    held = held_by(replace(record, parameters={**record.parameters, PLANT: plant}))
    assert reason in held.reason
    assert bool(held.reason) == bool(reason)


@pytest.mark.parametrize(
    ("node", "lost", "reason"),
    [
        (CONTROLLER, "momentum_tube.assumed.W2", "the record lacks the parameter"),
        (PLANT, "wheels.inertia", "wheels.inertia has 2 values"),
    ],
)
def test_numbers_lost_or_impossible_void_the_promise(node: str, lost: str, reason: str) -> None:
    record = with_parameters(record_of("guaranteed", "wheels"), node, {lost: [0.0, 0.0]})
    if node == CONTROLLER:
        del record.parameters[node][lost]
    assert held_by(record).reason.startswith(reason)


def test_a_craft_is_known_where_nothing_is_told_of_its_environment() -> None:
    record = record_of("guaranteed")
    heard = replace(record, parameters={**record.parameters, INJECTOR: {}})
    assert not held_by(heard).reason
    weak = held_by(with_parameters(heard, PLANT, {"max_torque": 0.01}))
    assert weak.reason == "max_torque = 0.01 N·m; assumed: at least 0.05"


def test_without_the_motion_of_the_reference_nothing_is_judged() -> None:
    record = without_columns(record_of("guaranteed"), REFERENCE_ACCELERATION.column)
    assert held_by(record).reason == f"the record lacks {REFERENCE_ACCELERATION.column}"


def test_without_what_the_law_was_told_its_knowledge_is_not_judged() -> None:
    record = record_of("guaranteed")
    true = {f"truth_{name}": record[name] for name in ("attitude", "angular_velocity")}
    held = held_by(with_columns(without_columns(record, "angular_velocity"), **true))
    assert not held.outside.any()


def test_a_broken_promise_is_found() -> None:
    """Also where the law tells another error than the craft has."""
    record = record_of("guaranteed")
    beyond = record["turn_envelope"][1000:1010, 0] * 1.01
    turn, attitude = record["turn"].copy(), record["attitude"].copy()
    turn[1000:1010, 0] = beyond
    desired = Rotation.from_quat(record[REFERENCE_ATTITUDE.column][1000:1010])
    away = Rotation.from_rotvec(beyond[:, None] * [1.0, 0.0, 0.0])
    attitude[1000:1010] = (desired * away).as_quat()
    rate = record["angular_velocity"].copy()
    limit = record.parameters[CONTROLLER]["momentum_tube.assumed.Omega"]
    rate[1000:1010] = [0.0, 0.0, 1.01 * limit]
    for changed in ({"turn": turn}, {"attitude": attitude}, {"angular_velocity": rate}):
        held = held_by(with_columns(record, **changed))
        assert np.flatnonzero(held.outside).tolist() == list(range(1000, 1010))


def test_what_estimation_errors_may_add_breaks_no_promise(designed: tuple[str, str]) -> None:
    """The law sees its momentum error N, and the turn e_A, beyond what the craft has."""
    record = record_of(*designed)
    values = record.parameters[CONTROLLER]
    tube = np.add(values["momentum_tube.Y"], values["momentum_tube.N"])
    assert (record["momentum_tube"] == tube).all()
    seen = record["turn"].copy()
    for share, outside in ((0.9, []), (1.1, [1000])):
        seen[1000] = record["turn_envelope"][1000] + share * values["momentum_tube.e_A"]
        held = held_by(with_columns(record, turn=seen))
        assert np.flatnonzero(held.outside).tolist() == outside


def test_a_law_without_certificate_has_no_such_row() -> None:
    assert certificate_held(record_of()) is None
    bare = record_of(ppc_controller={"controller": "momentum_tube"})
    assert certificate_held(bare) is None
