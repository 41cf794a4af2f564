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

"""Parts in a package of somebody else's that fit badly or not at all; each is made on demand."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import outside_parts

from ppc_attitude.science.actuators import ideal
from ppc_attitude.science.attitude import euler_step, kinematics, normalised
from ppc_attitude.science.component import BODY, VECTOR, Column, Component
from ppc_attitude.science.controllers.common import ATTITUDE_ENVELOPE
from ppc_attitude.science.disturbances import pulses
from ppc_attitude.science.kernel import kernel, quaternion, store, store_quaternion, vector
from ppc_attitude.science.parameter import Parameter, filled, record_type
from ppc_attitude.science.plants.gyrostat import COMPONENT as GYROSTAT
from ppc_attitude.science.sensors.direct import SEED
from ppc_attitude.science.signals import (
    ANGULAR_VELOCITY,
    ENVIRONMENT_TORQUE,
    REFERENCE_ATTITUDE,
    TOLD,
    TORQUE_COMMAND,
    TRUTH,
)
from ppc_attitude.science.wheels import PARAMETERS as WHEELS

LAW, PLANT, SENSORS = outside_parts.LAW, outside_parts.PLANT, outside_parts.SENSORS
NOISE = record_type(SEED)


def with_column(part: Component, **chosen: Any) -> Component:
    """Give a part one more column."""
    declared = {"name": "mine", "topic": "mine/numbers", "form": VECTOR, "frame": BODY, "unit": "1"}
    column = Column(meaning="x", **(declared | chosen))
    return replace(part, outputs=(*part.outputs, column))


def with_parameters(part: Component, *parameters: Parameter) -> Component:
    """Give a part more parameters."""
    return replace(part, parameters=(*part.parameters, *parameters))


MARGIN = Column(
    "margin", "mine/margin", VECTOR, BODY, "1", "bound", width=1, bounds="attitude_error"
)
WITH_MARGIN = (*LAW.outputs, MARGIN, replace(ATTITUDE_ENVELOPE, bounds=""))


@kernel
def step_with_margin(inputs: Any, state: Any, gains: Any, outputs: Any) -> None:
    """Do as the law does, within a margin of its own; the envelope of others means nothing to it.

    The margin is passed from 0.5 s on.
    """
    outside_parts.step_law(inputs, state, gains, outputs)
    outputs.margin[0] = 1.0 if inputs.t < 0.5 else 1e-9
    outputs.attitude_envelope[:] = 2.0


@kernel
def step_blind(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Look at nothing but the reference."""
    outputs.torque_command[0] = 1e-3 * inputs.reference_attitude[0]


BLIND = Component(name="", inputs=(REFERENCE_ATTITUDE,), outputs=(TORQUE_COMMAND,), step=step_blind)


@kernel
def step_quiet(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Say nothing at first."""
    if inputs.t >= 0.05:
        outside_parts.step_estimator(inputs, state, configuration, outputs)


@kernel
def step_gusty(inputs: Any, state: Any, noise: Any, outputs: Any) -> None:
    """Push by what the seed says, at all times alike."""
    outputs.environment_torque[0] = 1e-6 * (noise.seed % 1000)


@kernel
def step_beyond(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Write beyond the only number of the last column."""
    outputs.torque_use[1] = 1.0


@kernel
def step_failing_sensors(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Raise after a while."""
    outside_parts.step_sensors(inputs, state, configuration, outputs)
    if inputs.t > 0.1:
        raise ValueError("the cap is on")


@kernel
def step_tilted(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Tell another attitude than there is, by 2e-4 rad."""
    q = quaternion(inputs.truth_attitude)
    store_quaternion(outputs.attitude, normalised(euler_step(q, 1.0, kinematics(q, (2e-4, 0, 0)))))
    store(outputs.angular_velocity, vector(inputs.truth_angular_velocity))


@kernel
def step_table(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Know nothing of what comes after a while."""
    if inputs.t > 0.1:
        raise ValueError("beyond my table")


RATE_LIMIT = Column(
    "rate_limit", "mine/rate_limit", VECTOR, BODY, "rad/s", "limit", width=1, bounds="rate_change"
)
BOUNDED = (*outside_parts.ESTIMATOR.outputs, RATE_LIMIT)


@kernel
def step_bounded(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Do as the estimator does, within no limit at all."""
    outside_parts.step_estimator(inputs, state, configuration, outputs)
    outputs.rate_limit[0] = 0.0


MADE: dict[str, Callable[[], Component]] = {
    "other_column": lambda: with_column(LAW, name="attitude"),
    "other_topic": lambda: with_column(LAW, topic="torque_command"),
    "clock": lambda: with_column(LAW, topic="clock"),
    "first": lambda: with_column(PLANT, name="pair", topic="pair"),
    "second": lambda: with_column(SENSORS, name="pair", topic="pair", unit="m"),
    "illegal": lambda: with_column(LAW, topic="bad topic!"),
    "absolute": lambda: with_column(LAW, topic="/mine"),
    "boundless": lambda: with_column(LAW, bounds="attitude_eror"),
    "of_itself": lambda: with_column(LAW, bounds="mine"),
    "of_unit": lambda: with_column(LAW, bounds="unsaturated_torque"),
    "of_two": lambda: with_column(
        with_column(LAW, bounds="attitude_error"),
        name="other",
        topic="other",
        bounds="attitude_error",
    ),
    "of_another": lambda: replace(
        LAW, outputs=(*LAW.outputs, replace(ATTITUDE_ENVELOPE, bounds="attitude"))
    ),
    "of_width": lambda: with_column(LAW, bounds="torque_use"),
    "nameless": lambda: with_column(LAW, name=""),
    "twice": lambda: replace(LAW, outputs=(*LAW.outputs, LAW.outputs[-1])),
    "of_node": lambda: with_parameters(LAW, Parameter("wait_for_recorder", 3, "x")),
    "sure": lambda: replace(SENSORS, exact=lambda _: True),
    "of_kind": lambda: with_parameters(SENSORS, Parameter("max_torque", 7.0, "x")),
    "of_front": lambda: with_parameters(LAW, Parameter("max_torque", 5.0, "mine", "mN·m")),
    "in_degrees": lambda: replace(LAW, inputs=(replace(ANGULAR_VELOCITY, unit="deg/s"),)),
    "of_ros": lambda: with_parameters(LAW, Parameter("use_sim_time", False, "x")),
    "selector": lambda: with_parameters(LAW, Parameter("controller", 3, "x")),
    "plain": lambda: replace(LAW, step=lambda *records: None),
    "two": lambda: with_parameters(LAW, Parameter("z", 3, "x"), Parameter("z", 4.0, "x")),
    "no_default": lambda: with_parameters(LAW, Parameter("z", None, "x")),  # type: ignore[arg-type]
    "beyond": lambda: with_parameters(LAW, Parameter("z", 3, "x", high=1)),
    "vast": lambda: with_parameters(LAW, Parameter("z", 2**70, "x")),
    "long_turn": lambda: with_parameters(LAW, Parameter("z", [0.0], "x", quaternion=True)),
    "unnamed_number": lambda: with_parameters(LAW, Parameter("", 3, "x")),
    "undescribed": lambda: with_parameters(LAW, Parameter("z", 3, None)),  # type: ignore[arg-type]
    "far": lambda: with_column(LAW, topic="m" * 151),
    "cubic": lambda: with_column(LAW, form="cube"),
    "of_four": lambda: with_column(LAW, form="vector", width=4),
    "of_no_part": lambda: with_column(LAW, form="efforts", width=4),
    "of_part": lambda: replace(LAW, outputs=(replace(LAW.outputs[-1], part="wheel"),)),
    "giver": lambda: with_column(LAW, name="asked", topic="asked"),
    "reader": lambda: replace(PLANT, inputs=(*PLANT.inputs, ASKED)),
    "of_objects": lambda: replace(LAW, state=np.dtype([("z", object)])),
    "of_money": lambda: with_column(LAW, unit="$"),
    "of_no_unit": lambda: with_column(LAW, unit=""),
    "of_no_frame": lambda: with_column(LAW, frame=""),
    "tilted": lambda: Component(
        name="",
        inputs=TRUTH,
        outputs=TOLD,
        step=step_tilted,
        noise=lambda values, rate: (1e-12, 0.0, 0.0),
    ),
    "hasty": lambda: replace(SENSORS, inputs=(*SENSORS.inputs, TORQUE_COMMAND)),
    "no_limit": lambda: replace(ideal.COMPONENT, limits=("nowhere",)),
    "no_quiet": lambda: replace(ideal.COMPONENT, quiet={"nowhere": 0.0}),
    "pulse": lambda: pulses.COMPONENT,
    "margin": lambda: replace(LAW, outputs=WITH_MARGIN, step=step_with_margin),
    "enveloped": lambda: with_column(LAW, bounds="attitude_error"),
    "beyond_column": lambda: replace(LAW, step=step_beyond),
    "failing": lambda: replace(SENSORS, step=step_failing_sensors),
    "quiet": lambda: replace(outside_parts.ESTIMATOR, step=step_quiet),
    "bounded": lambda: replace(outside_parts.ESTIMATOR, outputs=BOUNDED, step=step_bounded),
    "unnamed": lambda: replace(
        PLANT,
        parameters=(),
        configure=lambda _: PLANT.configure(PLANT.defaults),
    ),
    "unnamed_wheels": lambda: replace(
        GYROSTAT,
        name="unnamed_wheels",
        parameters=WHEELS,
        configure=lambda values: GYROSTAT.configure({**GYROSTAT.defaults, **values}),
    ),
    "gusty": lambda: replace(
        outside_parts.ENVIRONMENT,
        parameters=(SEED,),
        configuration=NOISE,
        configure=lambda values: filled(NOISE, values),
        step=step_gusty,
        bound=None,
    ),
    "table": lambda: Component(name="", outputs=(ENVIRONMENT_TORQUE,), step=step_table),
    "listening": lambda: replace(BLIND, inputs=(*BLIND.inputs, outside_parts.RATE_CHANGE)),
    "chatty": lambda: replace(LAW, advice=lambda _: "well"),
    "blind": lambda: BLIND,
}


ASKED = Column("asked", "asked", VECTOR, BODY, "m", "what a law gives, in another unit")


NAMES: dict[str, Any] = {"numbered": 5, "unlabelled": "", "ours": "ppc", "again": "other_column"}
"""Names that are none or taken, of parts that are called otherwise in the entry point."""


def __getattr__(name: str) -> Component:
    """Make the part of a name."""
    if name in NAMES:
        return replace(LAW, name=NAMES[name])
    if name not in MADE:
        raise AttributeError(name)
    return replace(MADE[name](), name=name)
