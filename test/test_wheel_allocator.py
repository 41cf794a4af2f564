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

"""The drive of the wheels as flight software, and the motors that take what it sends."""

import math
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bag_helpers import assert_flown
from conftest import StartProcess
from craft_helpers import ROOT, case, configs, part_of
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from peer import peer
from process_helpers import PAPER, Run

from ppc_attitude.bags.reader import read_run
from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.declared import BY_COLUMN
from ppc_attitude.contract.topics import (
    ALLOCATOR,
    ATTITUDE,
    PLANT,
    TORQUE_COMMAND,
)
from ppc_attitude.science import magnetorquers, wheels
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kinds import ACTUATORS, ALLOCATORS
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import load

FAULTS = ["wheel/1 effectiveness 0 from 2 for 3", "wheel/3 drag 4 from 1", "wheel/0 bias 1e-3"]
NUMBER = st.floats(-1.0, 1.0)


@pytest.mark.parametrize("faults", [[], FAULTS], ids=["sound", "failing"])
@pytest.mark.parametrize(
    ("craft", "alone"),
    [
        (("wheels",), "allocator"),
        (("wheels", "orbit", "unloading"), "allocator_unloading"),
    ],
)
def test_the_drive_moves_the_craft_as_the_same_drive_on_board(
    craft: tuple[str, ...], alone: str, faults: list[str]
) -> None:
    """A wheel begins beside its largest speed, so that every limit has its turn."""
    start = {"faults": faults, "wheels__initial_speed": [627.9, -300.0, 0.0, 50.0]}
    on_board = simulate(case(*craft, **start), 8.0)
    record = simulate(case(*craft, alone, **start).with_values(ALLOCATOR, faults=faults), 8.0)
    commands = {wheels.COMMAND.name, magnetorquers.COMMAND.name}
    assert record.columns.keys() - on_board.columns.keys() == commands & record.columns.keys()
    for name, expected in on_board.columns.items():
        assert_array_equal(record[name], expected, err_msg=name)
    # What is asked for and what is given differ where a wheel fails, and nowhere else.
    failed = (record[wheels.COMMAND.name] != record["wheel_torque"]).any(axis=0)
    assert failed[:4].tolist() == ([True, True, False, True] if faults else [False] * 4)


@pytest.mark.parametrize(
    "names", [("wheels", "allocator", "faults"), ("wheels", "allocator", "orbit", "unloading")]
)
def test_an_allocator_to_which_no_actuator_listens_is_refused(
    names: tuple[str, ...],
) -> None:
    """An overlay that comes later selects the drive on board; nobody would wait for the other."""
    message = "wheel_torque_command, which no selected component reads; actuator = wheel_motors or"
    with pytest.raises(ConfigurationError, match=message):
        load(configs(*names))


def test_an_actuator_may_describe_what_it_reads_in_its_own_words(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It was told that nobody reads what the allocator gives."""
    motors = ACTUATORS.components["wheel_motors"]
    own = tuple(replace(column, meaning="what I am to give") for column in motors.inputs)
    monkeypatch.setitem(ACTUATORS.components, "wheel_motors", replace(motors, inputs=own))
    chosen = load(configs("wheels", "allocator")).parameters[PLANT]
    assert chosen[ACTUATORS.selector] == motors.name


@settings(max_examples=200, deadline=None)
@given(st.lists(NUMBER, min_size=4, max_size=4), st.lists(NUMBER, min_size=4, max_size=4))
def test_no_torque_that_is_sent_passes_the_limits_of_motor_and_speed(
    torques: list[float], shares: list[float]
) -> None:
    """The limits are written once more: 0.05 N·m, and 628.3 rad/s at the end of the step."""
    motors = part_of(ACTUATORS, "wheel_motors", wheels__viscous=[0.0], wheels__static=[5e-4])
    speeds = [*(628.3 * share for share in shares), 0.0, 0.0, 0.0, 0.0]
    motors.step(0, [*torques, *[0.0] * 4, 0.02, -0.01, 0.03, *speeds])
    gave = motors.output("wheel_torque")
    for torque, given_, speed in zip(torques, gave, speeds, strict=False):
        friction = 5e-4 * np.tanh(speed / 0.1)
        lowest, highest = (friction + 8e-4 / 0.01 * (end - speed) for end in (-628.3, 628.3))
        expected = np.clip(torque, max(-0.05, lowest), min(0.05, highest))
        assert given_ == pytest.approx(expected, abs=1e-9)
    assert_array_equal(gave[4:], 0.0)


def test_motors_give_a_drive_what_it_asks_for_to_the_last_bit() -> None:
    """With a wheel beyond its largest speed they took off what the drive's rounding added."""
    random = np.random.default_rng(1)
    drive, motors = part_of(ALLOCATORS, "wheel_drive"), part_of(ACTUATORS, "wheel_motors")
    rest = [0.0] * 4  # of the eight speeds and torques
    for torque in 0.05 * random.standard_normal((3000, 3)):
        speeds = random.choice([-628.305, 628.305, 300.0], 4) - 0.005 * random.random(4)
        drive.step(0, [*torque.tolist(), 0.0, 0.0, 0.0, *speeds.tolist(), *rest])
        asked = drive.output("wheel_torque_command")
        motors.step(0, [*asked, 0.0, 0.0, 0.0, *speeds.tolist(), *rest])
        assert_array_equal(motors.output("wheel_torque"), asked)


def test_a_dipole_too_large_is_scaled_and_turns_the_craft() -> None:
    rods, field = part_of(ACTUATORS, "wheel_motors_rods"), [2e-5, -1e-5, 3e-5]
    for asked, given_ in (
        ([1.0, -2.0, 3.0], [1.0, -2.0, 3.0]),
        ([5.0, -40.0, 0.0], [1.25, -10, 0]),
    ):
        rods.step(0, [*[0.0] * 8, 0.0, 0.0, 0.0, *[0.0] * 8, *asked, *field])
        assert rods.output("magnetorquer_dipole") == pytest.approx(given_, rel=1e-15)
        turned = np.cross(given_, field)
        assert rods.output("applied_torque") == pytest.approx(turned, rel=1e-12)


def test_a_node_that_does_not_know_of_a_fault_goes_on_asking_the_lost_wheel() -> None:
    lost = ["wheel/2 effectiveness 0"]
    asks = [0.01, 0.0, 0.0, *[0.0] * 3, *[0.0] * 8]
    told = part_of(ALLOCATORS, "wheel_drive", *lost, wheels__detection_delay=0.0)
    untold = part_of(ALLOCATORS, "wheel_drive", wheels__detection_delay=0.0)
    told.step(0, asks)
    untold.step(0, asks)
    assert told.output(wheels.COMMAND.name)[2] == 0.0 != untold.output(wheels.COMMAND.name)[2]
    assert "wheel 2 lost: the others give the torque" in told.advice.text
    assert not untold.advice.text


def test_plant_and_drive_have_one_rate() -> None:
    message = "wheel_allocator: rate = 100.0; allowed: 50.0, as in spacecraft_plant"
    with pytest.raises(ConfigurationError, match=re.escape(message)):
        case("wheels", "allocator", rate=50.0)


@pytest.mark.ros
def test_the_allocators_node_gives_the_bits_of_the_loop(
    tmp_path: Path, start_process: StartProcess
) -> None:
    """Seven processes: with an estimator, the drive knows the estimated rate.

    After a second the rods begin their second period.
    """
    overlays = configs("wheels", "orbit", "unloading", "sensors_smallsat", "allocator_unloading")
    options = [f"--config={path}" for path in overlays]
    run = Run(start_process, tmp_path / "bag", "--duration", "1.5", *options)
    assert run.ends() == 0, run.err
    record = read_run(run.bag)
    assert_flown(record, simulate(load([PAPER, *overlays]), 1.5))
    assert ALLOCATOR in record.parameters


@pytest.mark.ros
def test_an_allocator_of_the_users_takes_its_place(start_process: StartProcess) -> None:
    """The example of the pages, between a plant that is started by hand and whoever commands it."""
    given = [f"--params-file={path}" for path in (PAPER, *configs("wheels", "allocator"))]
    words = ["--ros-args", *(word for each in given for word in each.split("="))]
    words += ["-p", "lockstep:=true", "-p", f"wait_for:=[{TORQUE_COMMAND.name}]"]
    with peer(TORQUE_COMMAND) as stack:
        stack.listen(BY_COLUMN[wheels.TORQUE.name])
        start_process([sys.executable, str(ROOT / "docs/examples/own_allocator.py")])
        start_process([sys.executable, "-m", f"ppc_attitude.nodes.{PLANT}", *words])
        states, motors = stack.heard[ATTITUDE.name], stack.heard[wheels.TORQUE.topic]
        codec, told = Codec(TORQUE_COMMAND), 0

        def command(stamp_ns: int) -> list[float]:
            return [0.05 * math.cos(rate * 1e-9 * stamp_ns) for rate in (3.0, 5.0, 7.0)]

        def answered() -> bool:
            nonlocal told
            for state in states[told:]:  # one that nobody answers in time comes again
                stack.send(TORQUE_COMMAND, codec.encode(state.stamp_ns, command(state.stamp_ns)))
            told = len(states)
            return len(motors) > 40

        stack.until(answered, "torques of commands")
    shares = -np.linalg.pinv(np.reshape(wheels.AXES.default, (4, 3)).T)
    for each in motors:  # the pseudo-inverse asks for 0.065 N·m, the drive for 0.043
        asked = np.clip(shares @ command(each.stamp_ns), -0.05, 0.05)
        assert each.values[:4] == pytest.approx(asked, abs=2e-10)
