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

"""The paper's requirements on the closed loop, from the configuration that users get."""

import math
import os
import subprocess
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from craft_helpers import configs, pulse
from record_helpers import settled_after

from ppc_attitude.contract.declared import BY_COLUMN
from ppc_attitude.contract.parameters import PARAMETERS
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import CONTROLLER, INJECTOR
from ppc_attitude.science.attitude import attitude_error
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kernel import matrix
from ppc_attitude.science.kinds import CONTROLLERS
from ppc_attitude.science.plants.rigid_body import rigid_body_step
from ppc_attitude.simulation.closed_loop import (
    Loop,
    first_instant,
    simulate,
    stamps_of,
    timetable_of,
)
from ppc_attitude.simulation.scenario import Scenario, load, scenario

# Powers of mass and of time in units; a unit that is not here has none.
POWERS = {
    **dict.fromkeys(("kg", "kg·m²"), (1.0, 0.0)),
    **dict.fromkeys(("N", "N·m", "A·m²"), (1.0, -2.0)),
    **dict.fromkeys(("N·m·s", "N·m·s/rad"), (1.0, -1.0)),
    "kg^½·m": (0.5, 0.0),
    "s": (0.0, 1.0),
    **dict.fromkeys(("1/s", "Hz", "rad/s"), (0.0, -1.0)),
    "rad/s²": (0.0, -2.0),
    "rad/s³": (0.0, -3.0),
}


@cache
def run(*overlays: str, rate: float = 100.0, duration: float = 120.0) -> RunRecord:
    files = configs("paper", *overlays)
    return simulate(load(files, {"spacecraft_plant": {"rate": rate}}), duration)


def error(record: RunRecord) -> np.ndarray:
    return np.abs(record["attitude_error"][:, :3]).max(axis=1)


def fill(record: RunRecord, kind: str) -> np.ndarray:
    return np.abs(record[f"{kind}_error"][:, :3] / record[f"{kind}_envelope"]).max(axis=1)


@pytest.mark.parametrize("rate", [50.0, 100.0, 1000.0])
def test_the_normal_case_meets_every_requirement_of_the_paper(rate: float) -> None:
    record = run(rate=rate)
    assert settled_after(record) < 50.0
    assert error(record)[record.t >= 100.0].max() < 1e-4
    assert np.rad2deg(np.linalg.norm(record["angular_velocity"], axis=1)).max() <= 3.0
    assert np.abs(record["applied_torque"]).max() <= 0.05
    assert fill(record, "attitude").max() < 1.0
    # The feasible start of the rate error lies inside, too, and stays there.
    assert fill(record, "rate").max() < 1.0


def test_it_begins_where_the_paper_begins() -> None:
    record = run()
    assert record["attitude_error"][0] == pytest.approx(
        [-0.22952, 0.25933, -0.11266, -0.93133], abs=1e-5
    )
    assert np.all(record["attitude_error"][:, 3] < 0.0)  # to −1, the short way
    assert not first_instant(load(configs("paper")))[CONTROLLERS.name].advice.warning


@pytest.mark.parametrize("name", sorted(CONTROLLERS.components))
def test_the_first_step_alone_is_that_of_the_loop(name: str) -> None:
    case = scenario(
        {
            "ppc_controller": {"controller": name},
            "reference_generator": {"mode": "paper_ahead"},  # which gives what any law reads
            "spacecraft_plant": {"attitude_noise": 1e-3, "rate_noise": 1e-4, "seed": 3},
        }
    )
    law, record = first_instant(case)[CONTROLLERS.name], simulate(case, 0.1)
    for column in case.controller.outputs:
        assert law.outputs[0][column.name].tolist() == record[column.name][0].tolist()


def test_hits_are_recovered_with_widening() -> None:
    record = run("sudden_disturbance", duration=140.0)
    assert settled_after(record, 80.0) < 10.0
    assert fill(record, "attitude").max() < 1.0
    outside = fill(record, "rate") > 1.0
    for start in (20.0, 80.0):
        window = (record.t >= start) & (record.t < start + 30.0)
        assert np.count_nonzero(outside & window) * 0.01 <= 0.5
    assert np.abs(record["applied_torque"]).max() <= 0.05


def test_hits_are_not_recovered_within_a_minute_without_widening() -> None:
    record = run("sudden_disturbance", "no_widening", duration=140.0)
    assert settled_after(record, 80.0) > 59.9
    narrow = record["attitude_envelope"][record.t > 60.0]
    assert np.all(narrow == 5e-3)


@pytest.mark.long
def test_what_is_warmed_up_is_found_by_the_next_process(tmp_path: Path) -> None:
    code = (
        "from ppc_attitude.simulation.closed_loop import warm_up\n"
        "from ppc_attitude.simulation.scenario import scenario\n"
        "warm_up(scenario({'ppc_controller': {'controller': 'quaternion_feedback'}}))"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}

    def compiled() -> set[Path]:
        subprocess.run([sys.executable, "-c", code], env=environment, check=True)
        return {*tmp_path.rglob("*.nbc")}

    first = compiled()
    assert any("part" in file.name for file in first)
    assert compiled() == first


def test_stamps_include_both_ends() -> None:
    assert stamps_of(100.0, 0.03).tolist() == [0, 10_000_000, 20_000_000, 30_000_000]
    assert stamps_of(3.0, 1.0).tolist()[-1] == 1_000_000_000


@pytest.mark.parametrize("overlays", [("sensors_smallsat",), ("wheels", "orbit", "unloading")])
def test_a_loop_remembers_nothing_of_the_scenario_before(overlays: tuple[str, ...]) -> None:
    case, stamps = load(configs("paper", *overlays)), stamps_of(100.0, 1.0)
    other = case.overlaid(
        {
            "spacecraft_plant": {"initial_attitude": [0.0, 0.0, 0.6, 0.8], "seed": 9},
            "ppc_controller": {"k": 0.2},
            "disturbance_injector": pulse(0.5, 0.1, 0.1, 0.0, 0.0),
        }
    )
    loop = Loop(case, stamps)
    for each in (other, case, other):
        found, alone = loop.run(each), simulate(each, 1.0)
        assert found.parameters == alone.parameters
        for name, column in alone.columns.items():
            assert found[name].tobytes() == column.tobytes(), name
    assert not np.array_equal(simulate(case, 1.0)["attitude"], found["attitude"], equal_nan=True)


def test_a_loop_refuses_other_components_and_the_timetable_of_another_run() -> None:
    """It ran its own law under the other's name, and read beyond the end of the timetable."""
    case, stamps = load(configs("paper")), stamps_of(100.0, 1.0)
    with pytest.raises(ConfigurationError, match=r"log_barrier.*; allowed in this loop: .*ppc"):
        Loop(case, stamps).run(load(configs("paper", "traditional")))
    short = timetable_of(case, stamps_of(100.0, 0.5))
    with pytest.raises(ConfigurationError, match=r"timetable of shape .*, 51.; allowed: .*, 101."):
        Loop(case, stamps, short).run(case)
    wrong = case.overlaid({"spacecraft_plant": {"initial_attitude": [0.0, 0.0, 0.0, 2.0]}})
    for begin in (lambda: simulate(wrong, 1.0), lambda: Loop(case, stamps).run(wrong)):
        with pytest.raises(
            ConfigurationError, match=r"^spacecraft_plant: initial_attitude = .* norm 2"
        ):
            begin()
    whole = Loop(case, stamps, timetable_of(case, stamps)).run(case)
    assert np.array_equal(whole["attitude"], simulate(case, 1.0)["attitude"])


@pytest.mark.parametrize("duration", [math.nan, math.inf, -1.0])
def test_a_run_has_a_finite_duration(duration: float) -> None:
    with pytest.raises(ConfigurationError, match=f"duration = {duration:g} s; allowed: finite"):
        simulate(load(configs("paper")), duration)


def test_the_samples_of_an_instant_belong_together() -> None:
    """Both torques of a stamp, held, carry its state to the next; the error is of its stamp."""
    record = run("sudden_disturbance", duration=140.0)
    values = load(configs("paper")).parameters["spacecraft_plant"]
    inertia = np.array(values["inertia"]).reshape(3, 3)
    moments = matrix(inertia), matrix(np.linalg.inv(inertia))
    for k in (0, 1999, 2000, 2009, 2010, 8005):
        q, omega = (tuple(record[c][k].tolist()) for c in ("attitude", "angular_velocity"))
        torque = tuple(record["applied_torque"][k] + record["disturbance_torque"][k])
        h = (record.stamps_ns[k + 1] - record.stamps_ns[k]) * 1e-9
        after = rigid_body_step(q, omega, torque, *moments, h)
        assert after[0] == tuple(record["attitude"][k + 1])
        assert after[1] == tuple(record["angular_velocity"][k + 1])
        q_e = attitude_error(q, tuple(record["reference_attitude"][k].tolist()))
        assert q_e == tuple(record["attitude_error"][k])


def factor(unit: str, mass: float, time: float) -> float:
    """Factor on a number of a unit, if mass and time are so many times as large."""
    of_mass, of_time = POWERS.get(unit, (0.0, 0.0))
    return mass**of_mass * time**of_time


def scaled(base: Scenario, mass: float, time: float = 1.0) -> Scenario:
    """The craft, its actuators and its torques as heavy or strong, and all of it as slow."""
    chosen = {node: dict(values) for node, values in base.parameters.items()}
    for node, table in PARAMETERS.items():
        for each in table:
            if each.unit in POWERS:
                numbers = np.multiply(factor(each.unit, mass, time), chosen[node][each.name])
                with suppress(ConfigurationError):  # the default of a part that does not run
                    chosen[node][each.name] = each.checked(numbers.tolist())
    plates = np.reshape(chosen["disturbance_injector"]["orbit.plates"], (-1, 10))
    plates[:, 0] *= mass  # areas, which air and light push
    chosen["disturbance_injector"]["orbit.plates"] = plates.ravel().tolist()
    return scenario(chosen)


def apart(found: RunRecord, expected: RunRecord, mass: float, time: float = 1.0) -> float:
    """Largest difference of a column from the one that is expected, as a share of its largest."""
    shares = [0.0]
    for name, values in expected.columns.items():
        told = found[name] / factor(BY_COLUMN[name].unit, mass, time)
        assert np.array_equal(np.isnan(told), np.isnan(values)), name
        largest = np.nanmax(np.abs(values), initial=1e-300)
        shares.append(np.nanmax(np.abs(told - values), initial=0.0) / largest)
    return max(shares)


def without_constants(law: str, *overlays: str) -> Scenario:
    """The paper's case without its environment, which is a torque in N·m."""
    environment = "orbit" if "orbit" in overlays else "none"
    nodes = {CONTROLLER: {"controller": law}, INJECTOR: {"environment": environment}}
    return load(configs("paper", *overlays), nodes)


@pytest.mark.parametrize("mass", [2.0**-20, 2.0**14])
@pytest.mark.parametrize(
    ("law", "overlays"),
    [
        ("momentum_tube", ["flexible", "wheels", "orbit", "unloading", "sudden_disturbance"]),
        ("log_barrier", ["sensors_smallsat", "sudden_disturbance"]),
        ("quaternion_feedback", ["thrusters"]),
        ("quaternion_feedback", ["wheels", "faults", "mission", "orbit"]),
    ],
)
def test_no_part_of_the_loop_knows_how_heavy_a_craft_is(
    law: str, overlays: list[str], mass: float
) -> None:
    """From a PocketQube to a station: a power of two scales every number without rounding."""
    base = without_constants(law, *overlays)
    assert apart(simulate(scaled(base, mass), 25.0), simulate(base, 25.0), mass) == 0.0


@pytest.mark.parametrize("time", [2.0**-2, 2.0**2])
@pytest.mark.parametrize(
    ("law", "overlays"),
    [("ppc", []), ("quaternion_feedback", ["flexible", "wheels", "sudden_disturbance"])],
)
def test_no_part_of_the_loop_knows_how_fast_a_craft_is(
    law: str, overlays: list[str], time: float
) -> None:
    """Every parameter has the unit that it is declared with; stamps of 1 ns are rounded."""
    base = scaled(without_constants(law, *overlays), 2.0**-20)  # tanh of a small torque is linear
    slower = simulate(scaled(base, 1.0, time), 25.0 * time)
    assert apart(slower, simulate(base, 25.0), 1.0, time) < 1e-9


def test_the_envelopes_of_a_heavy_craft_widen_with_larger_gains() -> None:
    """As the theory says: tanh of a torque in N·m has no larger value than 1."""
    heavy = scaled(without_constants("ppc", "sudden_disturbance"), 1024.0)
    gains = {name: 1024.0 * heavy.parameters[CONTROLLER][name] for name in ("C_tau", "B_tau")}
    worse, better = (
        simulate(each, 120.0) for each in (heavy, heavy.with_values(CONTROLLER, **gains))
    )
    assert fill(worse, "attitude")[-1] > 1.0
    assert fill(better, "attitude").max() < 1.0
    assert settled_after(better) == pytest.approx(83.77, abs=0.01)
