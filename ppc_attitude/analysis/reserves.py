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

"""What the actuators of a run were asked for, and have left: speed of wheels, and fuel.

Numbers of wheels and tank are the plant's parameters; a bag may lack them.
"""

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from ppc_attitude.analysis.measure import Measured
from ppc_attitude.analysis.series import absent_in, has, is_finite, largest, samples
from ppc_attitude.analysis.verdict import Requirement
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import APPLIED_TORQUE, PLANT
from ppc_attitude.science import wheels
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.stamps import instant
from ppc_attitude.science.thrusters import FUEL, FUEL_USED

RESERVE = 0.99
"""Largest share of its largest speed that a wheel may reach [1]."""


def wheel_shares(record: RunRecord) -> Array | None:
    """Ratio of each wheel's speed to its limit, shape (n, count); None if a limit is unknown."""
    speeds = np.abs(samples(record, wheels.SPEED.name))
    with suppress(KeyError, TypeError, ValueError):  # a bag may hold any parameters
        limits = record.parameters[PLANT][wheels.MAX_SPEED.name]
        each = np.pad(limits, (0, speeds.shape[1] - len(limits)), mode="edge")  # one is for all
        return np.asarray(speeds / each)
    return None


def wheel_momentum(record: RunRecord) -> Array | None:
    """‖Σ J_s Ω_w a‖ [N·m·s] at each instant, shape (n,); None if the wheels are not on record."""
    if not has(record, wheels.SPEED.name):
        return None
    plant, speeds = record.parameters.get(PLANT, {}), samples(record, wheels.SPEED.name)
    with suppress(KeyError, TypeError, ValueError, ConfigurationError):
        return np.asarray(np.linalg.norm(wheels.momenta(plant, speeds), axis=1))
    return None


def judge_actuators(run: Measured) -> Iterator[Requirement]:
    """Judge the torque's chatter, the wheels' momentum and speed, and the fuel."""
    if run.required.chatter is not None:
        yield _chatter(run, run.required.chatter)
    yield from _judge_wheels(run)
    yield from _judge_fuel(run)


def _chatter(run: Measured, limit: float) -> Requirement:
    """Judge the torque that alternates from sample to sample once the craft has settled.

    Its amplitude is the root mean square of (τ_k − 2 τ_{k−1} + τ_{k−2})/4 on the worst axis: a for
    a torque that alternates between a and −a, and h² τ''/4 for a smooth one.
    """
    torque, most = APPLIED_TORQUE.column, None
    if has(run.record, torque):
        told = np.where(run.settled[:, None], samples(run.record, torque), np.nan)
        swing = np.diff(told, 2, axis=0) / 4.0
        swing = swing[np.isfinite(swing).all(axis=1)]
        most = float(np.sqrt(np.square(swing).mean(axis=0)).max()) if swing.size else None
    row = ("chatter", most, limit, "N·m", run.lacks_settled, run.span_from_deadline)
    return run.row(*row, without=run.recoveries, columns=(torque,))


def _judge_wheels(run: Measured) -> Iterator[Requirement]:
    """Judge the wheels' momentum, and whether they could take it up."""
    columns = (wheels.SPEED.name,)
    if run.required.momentum is not None:
        held, why = wheel_momentum(run.record), ""
        if held is None:
            why = f"no parameters of the wheels ({wheels.INERTIA.name} of {PLANT}) on record"
        limit = run.required.momentum
        yield run.row("momentum", largest(held), limit, "N·m·s", why, columns=columns)
    if has(run.record, wheels.SPEED.name):
        shares, why = wheel_shares(run.record), run.changed(PLANT, wheels.MAX_SPEED.name)
        if shares is None and not why:
            why = f"no limits ({wheels.MAX_SPEED.name} of {PLANT}) on record"
        note = ""
        if shares is not None and len(above := np.argwhere(shares > RESERVE)):
            since, wheel = run.t[above[0, 0]], above[0, 1]
            told = f"wheel {wheel} is above the limit from {instant(since)} s on"
            note = f"{told}, so momentum runs out"
        row = ("wheel_speed", largest(shares), RESERVE, "", why)
        yield run.row(*row, note=note, columns=columns)


def _judge_fuel(run: Measured) -> Iterator[Requirement]:
    """Judge whether the fuel lasted."""
    if not has(run.record, FUEL_USED.name):
        return
    tank, why = run.plant.get(FUEL.name), run.changed(PLANT, FUEL.name)
    if not (isinstance(tank, float) and np.isfinite(tank)):  # a bag may hold any parameters
        tank, why = 0.0, why or f"no tank ({FUEL.name} of {PLANT}) on record"
    used, absent = run.largest_of(FUEL_USED.name), absent_in(run.record, FUEL_USED.name)
    # What is used until later tells of what was used before.
    absent = () if is_finite(run.record, FUEL_USED.name)[-1] else absent[-1:]
    yield run.row("fuel", used, tank, FUEL_USED.unit, why, strict=True, absent=absent)
