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

"""The samples of a run: their layout, and that writing them costs no memory."""

import math
import tracemalloc
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from craft_helpers import case
from numba.core.runtime import _nrt_python, rtsys

from ppc_attitude.science.component import BODY, VECTOR, Column
from ppc_attitude.science.kernel import kernel
from ppc_attitude.science.kinds import CONTROLLERS
from ppc_attitude.simulation.closed_loop import (
    Loop,
    by_column,
    stamps_of,
    timetable_of,
)
from ppc_attitude.simulation.diagram import Diagram, recorded_columns
from ppc_attitude.simulation.scenario import scenario

STEPS = 12_000
PAPER = scenario({})


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_every_recorded_column_has_its_own_rows(noise: float) -> None:
    case = scenario({"spacecraft_plant": {"attitude_noise": noise}})
    recorded = recorded_columns(case.parameters)
    samples = np.repeat(np.arange(sum(each.width for each in recorded)), 7).reshape(-1, 7)
    columns = by_column(recorded, np.arange(7), samples)
    assert ("truth_attitude" in columns) == bool(noise)
    assert [(name, rows.shape) for name, rows in columns.items()] == [
        (column.name, (7, column.width)) for column in recorded
    ]
    together = np.concatenate(list(columns.values()), axis=1)
    assert np.array_equal(together, np.broadcast_to(np.arange(together.shape[1]), together.shape))


LATE = Column("news", "news", VECTOR, BODY, "1", "a number that comes late", width=2, late=True)


@pytest.mark.parametrize(
    ("age", "place"),
    [(0.0, 5), (0.2, 3), (0.5, 0), (0.6, None), (-0.1, 6), (-0.2, None), (0.25, None)]
    + [(age, None) for age in (math.nan, math.inf, -math.inf, 1e300, -9.3e9)],
)
def test_a_late_sample_is_where_it_belongs_or_nowhere(age: float, place: int | None) -> None:
    samples = np.zeros((2, 7))
    samples[:, 5] = 2.0, age
    with np.errstate(all="raise"):
        told = by_column((LATE,), stamps_of(10.0, 0.6), samples)["news"]
    expected = np.full((7, 1), np.nan)
    if place is not None:
        expected[place] = 2.0
    assert np.array_equal(told, expected, equal_nan=True)


def test_of_late_samples_of_one_instant_the_first_counts() -> None:
    samples = np.zeros((2, 7))
    samples[:, 2], samples[:, 5] = (3.0, 0.1), (2.0, 0.4)
    told = by_column((LATE,), stamps_of(10.0, 0.6), samples)["news"]
    assert told[1] == 3.0


@pytest.fixture
def counted() -> Iterator[Callable[[Callable[[], object]], int]]:
    """Count the blocks of memory that compiled code takes while a function runs."""
    _nrt_python.memsys_enable_stats()

    def count(function: Callable[[], object]) -> int:
        before = rtsys.get_allocation_stats().alloc
        function()
        return int(rtsys.get_allocation_stats().alloc - before)

    yield count
    _nrt_python.memsys_disable_stats()


@kernel
def wasteful(steps: int) -> float:
    total = 0.0
    for step in range(steps):
        total += np.full(3, float(step))[1]
    return total


def test_an_allocation_in_a_step_would_be_seen(counted: Callable[..., int]) -> None:
    wasteful(1)
    assert counted(lambda: wasteful(STEPS)) >= STEPS


NOISE = {"attitude_noise": 1e-6, "rate_noise": 1e-7}
HIT = {"pulse_times": [80.0], "pulse_durations": [0.1], "pulse_torques": [0.8, 0.8, 0.8]}
CASES = {
    **{
        law: scenario(
            {
                "ppc_controller": {"controller": law},
                "reference_generator": {"mode": "paper_ahead"},  # which gives what any law reads
                "spacecraft_plant": NOISE,
                "disturbance_injector": HIT,
            }
        )
        for law in CONTROLLERS.components
    },
    **{
        names[-1]: case(*names)
        for names in (
            ("sensors_cubesat",),
            ("orbit",),
            ("wheels", "orbit", "unloading"),
            ("wheels", "allocator"),
            ("thrusters",),
        )
    },
    "wheels that fail": case("wheels", faults=["wheel/1 seized from 2", "wheel/0 drag 3"]),
}


@pytest.mark.parametrize("name", CASES)
def test_a_step_allocates_nothing(name: str, counted: Callable[..., int]) -> None:
    case = CASES[name]

    def costs(steps: int) -> tuple[int, int]:
        """Blocks that the compiled loop takes, and the most that Python holds meanwhile."""
        stamps = stamps_of(100.0, steps / 100.0)
        diagram = Diagram(case.parameters, timetable=timetable_of(case, stamps))
        samples = diagram.run(stamps)
        diagram.restart(case.parameters)
        tracemalloc.start()
        blocks = counted(lambda: diagram.run(stamps, samples))
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return blocks, peak

    few_blocks, few_bytes = costs(500)  # more than go to their rows together
    many_blocks, many_bytes = costs(STEPS)
    assert many_blocks == few_blocks
    assert many_bytes - few_bytes < 8 * STEPS  # less than one number a step


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("first", [0, 255, 256, 600])
def test_a_loop_knows_which_columns_are_finite(number: float, first: int) -> None:
    """From an instant on the environment's torque is no number, and what follows from it is none.

    Samples go to their rows 256 at a time, and the last ones are fewer.
    """
    stamps = stamps_of(100.0, 6.0)
    table = timetable_of(PAPER, stamps)
    torque = slice(-3, None)  # what the environment gives comes last
    assert Diagram(PAPER.parameters, ahead=True).columns[-1].name == "environment_torque"
    table[torque, first:] = number
    sound = Loop(PAPER, stamps, timetable_of(PAPER, stamps))
    assert sound.run(PAPER).columns.keys() == sound.whole
    loop = Loop(PAPER, stamps, table)
    record = loop.run(PAPER)
    finite = {name for name, rows in record.columns.items() if np.isfinite(rows).all()}
    assert loop.whole <= finite
    assert "disturbance_torque" not in finite
    if first < 600:  # it acts from the next instant on
        assert not finite & {"attitude", "angular_velocity", "torque_command"}
    # What is played is known together: the reference is as little known as the torque.
    assert finite - loop.whole <= {column for column in finite if column.startswith("reference_")}
