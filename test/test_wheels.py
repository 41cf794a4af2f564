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

"""Wheels and flexible modes: the motion, the allocation, the drive, and the laws with them."""

import gzip
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import StartProcess
from numpy.typing import NDArray
from process_helpers import PAPER, Run
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from ppc_attitude.analysis.metrics import analyse
from ppc_attitude.bags.reader import read_run
from ppc_attitude.contract.cdr import CdrError, Codec
from ppc_attitude.contract.declared import BY_COLUMN
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.science import multibody, wheels
from ppc_attitude.science.allocation import allocate, certain_torque
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kinds import ACTUATORS, PLANTS
from ppc_attitude.science.part import Part
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.replay import replay
from ppc_attitude.simulation.scenario import load, weakened

ROOT = Path(__file__).parent.parent
CONFIG = ROOT / "config"
STEP_NS = 10_000_000
Array = NDArray[np.float64]


def table(name: str) -> tuple[list[str], list[str], list[list[str]]]:
    """Lines that describe a table of `truth`, its columns, and its rows."""
    with gzip.open(ROOT / "test" / "truth" / f"{name}.csv.gz", "rt") as file:
        lines = file.read().splitlines()
    told = [line for line in lines if line.startswith("#")]
    columns, *rows = (line.split(",") for line in lines[len(told) :])
    return told, columns, rows


def numbers(line: str, *names: str) -> list[float]:
    """The number after each name in a line."""
    return [float(line.split(f"{name} ", 1)[1].split(maxsplit=1)[0].rstrip(";")) for name in names]


def plant_of(name: str, **values: Any) -> Part:
    component = PLANTS.components[name]
    given = {key.replace("__", "."): value for key, value in values.items()}
    return Part(component, {**component.defaults, "rate": 100.0, **given})


def actuator_of(**values: Any) -> Part:
    component = ACTUATORS.components["wheels"]
    given = {key.replace("__", "."): value for key, value in values.items()}
    return Part(component, {**component.defaults, "rate": 100.0, **given})


def angle(q: Array, p: Array) -> float:
    return float(4.0 * np.arcsin(0.5 * min(np.linalg.norm(q - p), np.linalg.norm(q + p))))


def padded(torques: Array) -> Array:
    return np.concatenate([torques, np.zeros(wheels.MAX_WHEELS - torques.size)])


@pytest.mark.parametrize(
    ("case", "allowed"),
    [("wheels_pyramid", (1e-12, 1e-13, 1e-10)), ("wheels_zero_crossing", (1e-7, 1e-8, 1e-5))],
)
def test_wheels_move_as_two_integrators_say(case: str, allowed: tuple[float, ...]) -> None:
    told, _, text = table(case)
    rows = np.array(text, np.float64)
    each = [line for line in told if line.startswith("# wheel ")]
    axes = [line.split("axis ")[1].split(";")[0].split() for line in each]
    sine = ("amplitude", "frequency", "phase", "offset")
    amplitude, frequency, phase, offset = np.array([numbers(line, *sine) for line in each]).T
    (friction,) = (line for line in told if line.startswith("# friction: "))
    names = ("viscous", "coulomb", "static", "stribeck", "transition")
    viscous, coulomb, static, stribeck, transition = numbers(friction, *names)
    part = plant_of(
        "gyrostat",
        initial_attitude=rows[0, 1:5].tolist(),
        initial_angular_velocity=rows[0, 5:8].tolist(),
        wheels__axes=[float(number) for axis in axes for number in axis],
        wheels__initial_speed=rows[0, 8:12].tolist(),
        wheels__viscous=[viscous],
        wheels__coulomb=[coulomb],
        wheels__static=[static],
        wheels__stribeck_speed=[stribeck],
        wheels__transition_speed=[transition],
    )
    torques, k = np.zeros(8), 0
    worst = np.zeros(3)
    for row in rows:
        while k <= round(100.0 * row[0]):
            told_now = np.array(part.step(k * STEP_NS, [*torques, 0.0, 0.0, 0.0]))
            if k % 10 == 0:  # each torque is held for 0.1 s
                swing = np.sin(2.0 * np.pi * frequency * (k / 100.0) + phase)
                torques = padded(amplitude * swing + offset)
            k += 1
        off = np.abs(told_now[:11] - row[1:12])
        worst = np.maximum(worst, [angle(told_now[:4], row[1:5]), off[4:7].max(), off[7:].max()])
    assert np.all(worst < allowed), worst


def test_one_wheel_spins_up_and_turns_the_body_back() -> None:
    part = plant_of(
        "gyrostat",
        wheels__axes=[0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        wheels__viscous=[0.0],
        wheels__coulomb=[0.0],
        wheels__static=[0.0],
    )
    spun = 8e-4 * (1.9 - 8e-4) / 1.9 * 200.0 * math.pi / 0.05
    for k in range(1005):
        given = part.step(k * STEP_NS, [0.05, *[0.0] * 10])
    assert spun == pytest.approx(10.04886, abs=1e-5)
    assert given[6] == pytest.approx(-0.2645552 * 10.04 / spun, rel=1e-6)
    assert given[7] == pytest.approx(200.0 * math.pi * 10.04 / spun, rel=1e-9)


def test_flexible_modes_move_as_two_integrators_say() -> None:
    told, _, text = table("flexible")
    rows = np.array(text, np.float64)
    modes = [line for line in told if line.startswith("# mode ")]
    coupling = [float(each) for line in modes for each in line.split("coupling ")[1].split()[:3]]
    part = plant_of(
        "flexible",
        inertia=[4.2, 0.0, 0.0, 0.0, 2.6, 0.0, 0.0, 0.0, 3.5],
        initial_attitude=rows[0, 1:5].tolist(),
        initial_angular_velocity=rows[0, 5:8].tolist(),
        flexible__frequency=[numbers(line, "frequency")[0] for line in modes],
        flexible__damping=[numbers(line.replace(",", ""), "ratio")[0] for line in modes],
        flexible__coupling=coupling,
    )
    worst, torque = np.zeros(3), np.zeros(3)
    for k in range(round(100.0 * rows[-1, 0]) + 1):
        given = np.array(part.step(k * STEP_NS, [*torque, 0.0, 0.0, 0.0]))
        torque = np.array([0.05, -0.02, 0.03]) if 100 <= k < 600 else np.zeros(3)
        if k % 10 == 0:
            row = rows[k // 10]
            bend = part.state[0]["motion"][multibody.BEND :]
            deflection = np.array([bend[0], bend[1], bend[6], bend[7]])
            off = [angle(given[:4], row[1:5]), np.abs(given[4:7] - row[5:8]).max()]
            worst = np.maximum(worst, [*off, np.abs(deflection - row[8:12]).max()])
    assert np.all(worst < (1e-9, 1e-8, 1e-7)), worst


def test_one_mode_on_one_axis_swings_by_its_closed_form() -> None:
    inertia, delta, clamped, damping, torque = 2.8, 1.2, 2.0 * math.pi * 0.35, 0.005, 0.05
    part = plant_of(
        "flexible",
        initial_attitude=[0.0, 0.0, 0.0, 1.0],
        flexible__frequency=[0.35],
        flexible__damping=[damping],
        flexible__coupling=[delta, 0.0, 0.0],
    )
    c = 1.0 - delta**2 / inertia
    swing, ratio = clamped / math.sqrt(c), damping / math.sqrt(c)
    free = swing * math.sqrt(1.0 - ratio**2)
    steady = -delta * torque / (inertia * clamped**2)
    assert swing / (2.0 * math.pi) == pytest.approx(0.50220, abs=1e-5)
    for k in range(1001):
        given = part.step(k * STEP_NS, [torque, 0.0, 0.0, 0.0, 0.0, 0.0])
        t = k / 100.0
        decay = steady * math.exp(-ratio * swing * t)
        lag = ratio / math.sqrt(1.0 - ratio**2)
        bent = steady - decay * (math.cos(free * t) + lag * math.sin(free * t))
        rate = decay * swing / math.sqrt(1.0 - ratio**2) * math.sin(free * t)
        assert part.state[0]["motion"][multibody.BEND] == pytest.approx(bent, abs=1e-8)
        assert given[4] == pytest.approx((torque * t - delta * rate) / inertia, abs=1e-8)


def test_without_wheels_and_modes_the_body_is_rigid() -> None:
    start = {
        "initial_attitude": [0.5, 0.5, -0.5, 0.5],
        "initial_angular_velocity": [0.1, -0.2, 0.3],
    }
    rigid, flexible = (plant_of(name, **start) for name in ("rigid_body", "flexible"))
    for k in range(1000):
        torque = [0.05 * math.sin(0.1 * k), 0.02, -0.03, 0.001, 0.0, 0.002]
        one, other = (part.step(k * STEP_NS, torque) for part in (rigid, flexible))
    assert np.abs(np.subtract(one, other)).max() < 1e-14


@pytest.mark.parametrize("seed", range(4))
def test_momentum_is_exchanged_and_never_made(seed: int) -> None:
    """Random wheels, modes and motor torques; inertial momentum R (J ω + Σ J_s Ω a + δᵀη')."""
    random = np.random.default_rng(seed)
    count, inertia = 3 + seed, np.diag([2.8, 2.5, 1.9])
    axes, coupling = random.normal(size=(count, 3)), 0.4 * random.normal(size=(2, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    part = plant_of(
        "gyrostat",
        inertia=inertia.ravel().tolist(),
        initial_angular_velocity=(0.05 * random.normal(size=3)).tolist(),
        wheels__axes=axes.ravel().tolist(),
        wheels__initial_speed=(100.0 * random.normal(size=count)).tolist(),
        flexible__frequency=[0.4, 1.1],
        flexible__damping=[0.005, 0.01],
        flexible__coupling=coupling.ravel().tolist(),
    )
    momenta, torques = [], np.zeros(8)
    for k in range(3000):
        given = np.array(part.step(k * STEP_NS, [*torques, 0.0, 0.0, 0.0]))
        torques = padded(0.05 * random.uniform(-1.0, 1.0, count))
        bending = part.state[0]["motion"][multibody.BEND_RATE :][:2]
        spin = 8e-4 * given[7 : 7 + count]
        body = inertia @ given[4:7] + axes.T @ spin + coupling.T @ bending
        momenta.append(Rotation.from_quat(given[:4]).apply(body))
    off = np.linalg.norm(np.array(momenta) - momenta[0], axis=1).max()
    assert off < 1e-9 * np.linalg.norm(momenta[0])


def arrays() -> dict[str, Array]:
    """Arrays of the table `allocation`, by name."""
    found = {}
    for line in table("allocation")[0]:
        name, _, rest = line.removeprefix("# ").partition(": axes (columns ")
        if rest:
            columns = rest.split("; for")[0].split(";")
            found[name] = np.array([column.split() for column in columns], np.float64)
    return found


def allocated(t: Array, axes: Array, low: Array, high: Array) -> tuple[float, Array]:
    torques = np.zeros(len(axes))
    given = tuple(t.tolist())
    load = allocate(given, axes, len(axes), low, high, np.zeros(len(axes)), torques)
    return load, torques


def test_torques_are_shared_as_linear_programming_does() -> None:
    known = arrays()
    _, columns, rows = table("allocation")
    for text in rows:
        row = dict(zip(columns, text, strict=True))
        axes = known[row["array"]]
        ones = np.ones(len(axes))
        t = np.array([row["tx"], row["ty"], row["tz"]], np.float64)
        load, torques = allocated(t, axes, -ones, ones)
        expected = np.array([row[f"u{k}"] for k in range(len(axes))], np.float64)
        size = np.abs(expected).max()
        assert load == pytest.approx(float(row["u_largest"]), rel=1e-12)
        assert np.abs(torques - expected).max() <= 1e-12 * size
        assert np.abs(axes.T @ torques - t).max() <= 1e-12 * size


@pytest.mark.parametrize("seed", range(20))
def test_no_other_sharing_loads_the_wheels_less(seed: int) -> None:
    """Any array, any limits: also parallel wheels, and several in one plane."""
    random = np.random.default_rng(seed)
    axes = random.normal(size=(int(random.integers(3, 9)), 3))
    if seed % 2:  # twice the coordinate axes, and one between them
        axes = np.vstack([np.eye(3), -np.eye(3), [[1.0, 1.0, 0.0]]])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    count = len(axes)
    low, high = -random.uniform(0.1, 2.0, count), random.uniform(0.1, 2.0, count)
    t = random.normal(size=3)
    load, torques = allocated(t, axes, low, high)
    assert np.abs(axes.T @ torques - t).max() < 1e-12
    assert np.all(torques <= load * high * (1.0 + 1e-9) + 1e-15)
    assert np.all(torques >= load * low * (1.0 + 1e-9) - 1e-15)
    # min v: A u = t, v low ≤ u ≤ v high
    below, above = np.column_stack([np.eye(count), -high]), np.column_stack([-np.eye(count), low])
    least = linprog(
        [*[0.0] * count, 1.0],
        A_ub=np.vstack([below, above]),
        b_ub=np.zeros(2 * count),
        A_eq=np.column_stack([axes.T, np.zeros(3)]),
        b_eq=t,
        bounds=[(None, None)] * count + [(0.0, None)],
    )
    assert load == pytest.approx(least.fun, rel=1e-9)


@pytest.mark.parametrize(
    ("name", "certain"),
    [("pyramid", 1.1547005), ("pyramid_without_0", 0.5773503), ("orthogonal_3_and_skew", 1.0)],
)
def test_what_an_array_gives_on_every_axis(name: str, certain: float) -> None:
    axes = arrays()[name]
    assert certain_torque(axes, np.ones(len(axes))) == pytest.approx(certain, rel=1e-7)


def test_the_drive_takes_friction_and_gyroscopic_torque_away() -> None:
    speeds, omega = padded(np.array([100.0, -50.0, 0.03, 300.0])), [0.02, -0.05, 0.03]
    command = [0.03, -0.02, 0.01]
    exact = actuator_of()
    given = np.array(exact.step(0, [*command, *omega, *speeds]))
    assert given[:3] == pytest.approx(command, abs=1e-16)
    # Without compensation the command lacks what friction and the wheels' momentum take.
    plain = actuator_of(wheels__friction_knowledge=0.0, wheels__gyroscopic_compensation=False)
    axes = np.reshape(wheels.AXES.default, (4, 3))
    momentum = 8e-4 * axes.T @ speeds[:4]
    lost = axes.T @ frictions(speeds) - np.cross(omega, momentum)
    given = np.array(plain.step(0, [*command, *omega, *speeds]))
    assert given[:3] - command == pytest.approx(lost, abs=1e-15)


def frictions(speeds: Array) -> Array:
    """Friction of each of four wheels [N·m], written once more from the specification."""
    coulomb, static, viscous, at = 5e-4, 8e-4, 3e-6, speeds[:4]
    dry = coulomb + (static - coulomb) * np.exp(-((at / 2.0) ** 2))
    return np.asarray(dry * np.tanh(at / 0.1) + viscous * at)


@pytest.mark.parametrize("overload", ["scale", "clip"])
def test_too_much_torque_is_scaled_or_clipped(overload: str) -> None:
    part = actuator_of(wheels__overload=overload, wheels__null_gain=0.0)
    command = np.array([0.2, 0.01, -0.05])
    given = np.array(part.step(0, [*command, 0.0, 0.0, 0.0, *[0.0] * 8]))
    assert np.abs(given[3:]).max() == pytest.approx(0.05, rel=1e-12)
    turned = np.linalg.norm(np.cross(given[:3], command)) / np.linalg.norm(command) ** 2
    assert (turned < 1e-15) == (overload == "scale")


def test_a_wheel_stops_at_its_largest_speed_and_the_drive_says_so() -> None:
    part = actuator_of(wheels__axes=np.eye(3).ravel().tolist())
    assert not part.advice.warning
    part.step(0, [0.03, 0.0, 0.0, 0.0, 0.0, 0.0, *padded(np.array([-628.2999, 0.0, 0.0]))])
    assert part.advice.warning
    assert "wheel 0 has reached its largest speed" in part.advice.text
    torque = part.output("applied_torque")
    assert 0.0 <= torque[0] < 1e-5
    # The other way there is all of it.
    part.step(STEP_NS, [-0.03, 0.0, 0.0, 0.0, 0.0, 0.0, *padded(np.array([-628.2999, 0.0, 0.0]))])
    assert part.output("applied_torque")[0] == pytest.approx(-0.03, rel=1e-12)


def test_what_is_clipped_leaves_the_other_axes_alone() -> None:
    part = actuator_of(wheels__axes=np.eye(3).ravel().tolist(), wheels__overload="clip")
    full = padded(np.array([-628.3, 0.0, 0.0]))
    given = np.array(part.step(0, [0.03, 0.02, -0.01, 0.0, 0.0, 0.0, *full]))
    assert given[:3] == pytest.approx([0.0, 0.02, -0.01], abs=1e-9)


def test_four_wheels_go_to_their_null_speed_without_a_torque() -> None:
    part, speeds = actuator_of(), np.zeros(8)
    for k in range(60_000):
        given = np.array(part.step(k * STEP_NS, [0.0] * 6 + [*speeds]))
        assert np.abs(given[:3]).max() < 1e-15
        speeds[:4] += 0.01 / 8e-4 * (given[3:7] - frictions(speeds))
    assert np.abs(speeds[:4]) == pytest.approx(np.full(4, 100.0), rel=1e-3)


@pytest.mark.ros
def test_nodes_with_wheels_and_modes_give_the_bits_of_the_loop(
    tmp_path: Path, start_process: StartProcess
) -> None:
    overlays = [CONFIG / f"{name}.yaml" for name in ("flexible", "wheels")]
    options = [each for path in overlays for each in ("--config", str(path))]
    run = Run(start_process, tmp_path / "bag", "--duration", "3", *options)
    assert run.ends() == 0, run.err
    record, expected = read_run(run.bag), simulate(load([PAPER, *overlays]), 3.0)
    assert not record.missing_messages
    assert record.columns.keys() == expected.columns.keys()
    for name, column in expected.columns.items():
        assert np.array_equal(record[name], column), name
    again = replay(record)
    assert {each.largest for each in (again.law, *again.others)} == {0.0}


def flown(*overlays: str, **changed: Any) -> RunRecord:
    case = load([CONFIG / f"{name}.yaml" for name in ("paper", *overlays)])
    for node, given in changed.items():
        case = case.with_values(node, **given)
    return simulate(case, case.number(PLANT, "duration"))


def test_the_papers_case_with_wheels_is_as_with_an_ideal_actuator() -> None:
    verdict = analyse(flown("wheels"))
    assert all(each.met for each in verdict.requirements)
    rows = {each.key: each for each in verdict.requirements}
    assert rows["settling_time"].value == pytest.approx(48.9)
    assert 0.5 < rows["wheel_speed"].value < 0.75


def test_what_friction_does_to_a_drive_that_does_not_know_it() -> None:
    """An independent study found 7.4 s outside ρ_ω and a terminal error of 1.7e-4."""
    given = {"wheels.friction_knowledge": 0.0, "wheels.null_speed": 0.0, "wheels.null_gain": 0.0}
    verdict = analyse(flown("wheels", spacecraft_plant=given))
    rows = {each.key: each for each in verdict.requirements}
    assert rows["outside_rate_envelope"].value == pytest.approx(7.4, abs=2.0)
    assert rows["terminal_error"].value == pytest.approx(1.7e-4, abs=0.3e-4)


def test_a_craft_whose_wheels_are_full_does_not_pass() -> None:
    verdict = analyse(flown("wheels", spacecraft_plant={"duration": 300.0}))
    rows = {each.key: each for each in verdict.requirements}
    assert rows["wheel_speed"].met is False
    assert rows["wheel_speed"].value == pytest.approx(1.0, abs=1e-3)


def test_a_weaker_actuator_has_smaller_limits_whatever_it_is() -> None:
    assert weakened({"actuator": "ideal", "max_torque": 0.05}, 0.5) == {"max_torque": 0.025}
    assert weakened({"actuator": "wheels", "wheels.max_torque": [0.04]}, 0.5) == {
        "wheels.max_torque": [0.02]
    }


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"wheels.axes": [1.0, 0.0, 0.0]}, "span space"),
        ({"wheels.axes": [0.0] * 9}, "longer than 1e-6"),
        ({"wheels.axes": [1.0, 0.0, 0.0] * 9}, "up to 8 axes"),
        ({"wheels.inertia": [1e-3, 1e-3]}, "2 values; allowed: 1, or 4"),
        ({"wheels.initial_speed": [700.0]}, "at most wheels.max_speed"),
        ({"wheels.static": [1e-4]}, "at least wheels.coulomb"),
        ({"wheels.max_torque": [1e-3]}, "more than its friction"),
        ({"wheels.transition_speed": [1e-3]}, "by a larger wheels.transition_speed, or rate"),
        ({"wheels.inertia": [5.0]}, "is less than that of its wheels"),
        ({"flexible.frequency": [0.5]}, "as many of each"),
        (
            {
                "flexible.frequency": [20.0],
                "flexible.damping": [0.01],
                "flexible.coupling": [0.1, 0.0, 0.0],
            },
            "the fastest mode swings",
        ),
    ],
)
def test_impossible_wheels_and_modes_are_refused(changed: dict[str, Any], reason: str) -> None:
    plant = PLANTS.components["gyrostat"]
    with pytest.raises(ConfigurationError, match=reason):
        Part(plant, {**plant.defaults, "rate": 100.0, **changed})


@pytest.mark.parametrize("column", ["wheel_speed", "wheel_torque"])
def test_a_message_of_wheels_is_a_joint_state(column: str) -> None:
    from rclpy.serialization import deserialize_message, serialize_message
    from sensor_msgs.msg import JointState

    codec, sent = Codec(BY_COLUMN[column]), tuple(k - 3.5 for k in range(8))
    data = codec.encode(12_000_000_345, sent)
    message = deserialize_message(data, JointState)
    assert message.name == [f"wheel_{k}" for k in range(8)]
    told, other = (message.velocity, message.effort)[:: 1 if column == "wheel_speed" else -1]
    assert (tuple(told), list(other), list(message.position)) == (sent, [], [])
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 345)
    # Of anybody else: other names, positions too, another frame.
    message.name, message.position = [""] * 3 + ["a long name"], [1.0] * 5
    message.header.frame_id = "other"
    told = codec.decode(serialize_message(message))
    assert (told.frame_id, told.values) == ("other", sent)
    rows = np.frombuffer(serialize_message(message) + data[:0], np.uint8)[None]
    assert codec.decode_rows(rows)[1].tolist() == [list(sent)]
    for length in range(len(data) - 4):
        with pytest.raises(CdrError):
            codec.decode(data[:length])
    message.velocity = message.effort = [1.0] * 4
    with pytest.raises(CdrError, match="for 4 joints; allowed: 8"):
        codec.decode(serialize_message(message))
