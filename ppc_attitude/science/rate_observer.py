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

"""A rate observer before a law, and a compensation of the disturbance that it estimates after it.

A gyro's noise would reach the torque at every step. The craft knows its own torque and inertia, so
it predicts the rate and corrects the prediction slowly. What the prediction lacks in the long run
is the disturbance torque d̂, which is subtracted from the command, so the law need not fight it.

A gyro gives the mean rate of an interval, so the prediction is compared at the interval's middle.

Every law gets this front. Without `rate_observer`, or with an observer of its own, a law is told
what was measured, and its torque is passed on unchanged. Without an attitude (a zero quaternion)
the torque is zero and the law is not stepped: it begins at the first estimate, and anew at the
first one after a gap, since its last torque has not acted over it.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numba
import numpy as np

from ppc_attitude.science.compiled_stamps import seconds
from ppc_attitude.science.component import Component
from ppc_attitude.science.controllers.common import INERTIA, MAX_TORQUE
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.inertia import inertia_matrix
from ppc_attitude.science.kernel import (
    NO_ATTITUDE,
    ZERO,
    Vector,
    add,
    apply,
    bounded,
    carray,
    clamp,
    kernel,
    matrix,
    norm,
    pointer_to,
    quaternion,
    scale,
    store,
    subtract,
    vector,
)
from ppc_attitude.science.parameter import Parameter, filled, record_type
from ppc_attitude.science.part import configured, kernel_of
from ppc_attitude.science.plants.rigid_body import angular_acceleration
from ppc_attitude.science.sensors.gyro import ANGULAR_RANDOM_WALK, RESOLUTION
from ppc_attitude.science.signals import TOLD

RATE_OBSERVER = Parameter(
    "rate_observer",
    0.0,
    "bandwidth ω_n of the rate observer before the law; 0: none",
    "rad/s",
    low=0.0,
    high=100.0,
)
FEEDFORWARD = Parameter(
    "disturbance_feedforward",
    False,
    "subtract the observer's disturbance estimate from the command",
)
MAX_DISTURBANCE = Parameter(
    "max_disturbance", 6e-3, "limit of the disturbance estimate, per axis", "N·m", above=0.0
)
PARAMETERS = (RATE_OBSERVER, FEEDFORWARD, MAX_DISTURBANCE, ANGULAR_RANDOM_WALK, RESOLUTION)
OBSERVER = record_type(
    ("frequency", np.float64),  # ω_n [rad/s]
    ("feedforward", np.float64),  # 1 or 0
    ("max_disturbance", np.float64),  # [N·m]
    ("max_torque", np.float64),  # [N·m] per axis
    ("white", np.float64),  # σ_v² [rad²/s]
    ("rounding", np.float64),  # LSB²/12 [rad²/s²]
    ("inertia", np.float64, (3, 3)),  # [kg·m²]
    ("inertia_inverse", np.float64, (3, 3)),
    ("answer", np.float64, (3,)),  # Σ_j |J⁻¹|_ij [1/(kg·m²)]: of the rate to 1 N·m on every axis
)
MEMORY = record_type(
    ("started", np.float64),
    ("stamp_ns", np.int64),  # of the last step
    ("step", np.float64),  # [s] from the one before; 0: there is none
    ("rate", np.float64, (3,)),  # ω̂ [rad/s] at the stamp
    ("disturbance", np.float64, (3,)),  # d̂ [N·m]
    ("torque", np.float64, (3,)),  # command [N·m] since the stamp
    ("exponent", np.float64),  # ω_n Δt of the last correction
    ("decay", np.float64),  # p of it
    ("surprised", np.float64),  # 1 if the last residual was beyond its bound
    ("blind", np.float64),  # 1 where there is no attitude
    ("gaps", np.int64),  # how many gaps without an attitude are over
)
_SURPRISE = 5.0  # σ of a sample
_LOST = 1.0  # [rad] in a step; below it ½ Δt ‖J⁻¹ (ω̂ × J ω̂)‖ is less than ‖ω̂‖/3
_HELD = 0.5  # [s] after which an actuator that hears nothing gives no torque
_WIDE = 3.0  # σ of d̂'s own noise that its limit must leave room for


def observer_record(values: Mapping[str, Any]) -> Any:
    """Record of dtype `OBSERVER` from the controller's checked parameters.

    Raises
    ------
    ConfigurationError
        The estimate's own noise leaves no room below `max_disturbance`.
    """
    inertia = inertia_matrix("inertia", values["inertia"])
    inverse = np.linalg.inv(inertia)
    frequency, white = values[RATE_OBSERVER.name], values[ANGULAR_RANDOM_WALK.name]
    limit = values[MAX_DISTURBANCE.name]
    noise = disturbance_sigma(frequency, white, float(np.linalg.norm(inertia, axis=1).max()))
    if _WIDE * noise > limit:
        raise ConfigurationError(
            f"{RATE_OBSERVER.name} = {frequency} rad/s gives the disturbance estimate a noise of "
            f"{noise:.3g} N·m (1σ); allowed: at most {MAX_DISTURBANCE.name}/{_WIDE:g} = "
            f"{limit / _WIDE:.3g} N·m. Use a slower observer or a larger limit"
        )
    return filled(
        OBSERVER,
        values,
        frequency=frequency,
        feedforward=values[FEEDFORWARD.name],
        white=white**2,
        rounding=values[RESOLUTION.name] ** 2 / 12.0,
        inertia=inertia,
        inertia_inverse=inverse,
        answer=np.abs(inverse).sum(axis=1),
    )


def rate_sigma(frequency: float, white: float) -> float:
    """σ of ω̂ [rad/s]: √(1.25 ω_n) σ_v, from the transfer (2 ω_n s + ω_n²)/(s + ω_n)²."""
    return math.sqrt(1.25 * frequency) * white


def disturbance_sigma(frequency: float, white: float, inertia: float) -> float:
    """σ of d̂ on an axis [N·m]: ½ ‖J_i‖ ω_n^1.5 σ_v, from the transfer J s ω_n²/(s + ω_n)².

    The inertia [kg·m²] is the norm of the axis's row of J.
    """
    return 0.5 * inertia * math.pow(frequency, 1.5) * white


@kernel
def observe(observer: Any, memory: Any, stamp_ns: int, measured: Vector) -> Vector:
    """Rate ω̂ [rad/s] at a stamp [ns] from the measured mean rate of the interval that ends there.

    a = J⁻¹ (τ + d̂ − ω̂ × J ω̂), ω⁻ = ω̂ + Δt a, r = ω_k − ½ (ω⁻ + ω̂), p = e^{−ω_n Δt};
    ω̂ ← ω⁻ + (1 − p²) r and d̂ ← d̂ + (1 − p)²/Δt · J r with r bounded by ±g. Two residuals
    beyond g in a row are a hit: then ω̂ starts anew from the measurement, ½ Δt a further on, and
    d̂ stays; a is left out where ω̂ was so wrong that its ω̂ × J ω̂ could only lead away. So it
    starts after a gap, too, over which nobody knows the torque that acted.
    """
    h = seconds(stamp_ns - memory.stamp_ns)
    is_gap = 0.0 < 2.0 * memory.step < h and h > _HELD
    memory.stamp_ns = stamp_ns
    if memory.started == 0.0 or is_gap:
        if memory.started == 0.0:
            store(memory.disturbance, ZERO)
        memory.started = 1.0
        memory.step = 0.0
        memory.surprised = 0.0
        store(memory.rate, measured)
        return measured
    memory.step = h
    inertia = matrix(observer.inertia)
    before, d = vector(memory.rate), vector(memory.disturbance)
    acceleration = angular_acceleration(
        before, add(vector(memory.torque), d), inertia, matrix(observer.inertia_inverse)
    )
    predicted = add(before, scale(h, acceleration))
    r = subtract(measured, scale(0.5, add(predicted, before)))
    noise = _SURPRISE * math.sqrt(observer.white / h + observer.rounding)
    room = scale(h * observer.max_disturbance, vector(observer.answer))
    g = add((noise, noise, noise), room)
    surprised = abs(r[0]) > g[0] or abs(r[1]) > g[1] or abs(r[2]) > g[2]
    if surprised and memory.surprised != 0.0:
        turned = h * norm(before)
        rate = add(measured, scale(0.5 * h, acceleration)) if turned < _LOST else measured
    else:
        if observer.frequency * h != memory.exponent:
            memory.exponent = observer.frequency * h
            memory.decay = math.exp(-memory.exponent)
        p = memory.decay
        rate = add(predicted, scale(1.0 - p * p, r))
        s = (1.0 - p) * (1.0 - p) / h
        x, y, z = inertia
        d = add(d, apply((scale(s, x), scale(s, y), scale(s, z)), bounded(r, g)))
        store(memory.disturbance, clamp(d, observer.max_disturbance))
    memory.surprised = 1.0 if surprised else 0.0
    store(memory.rate, rate)
    return rate


@kernel
def compensate(observer: Any, memory: Any, torque: Vector) -> Vector:
    """Return a law's torque [N·m] less the disturbance estimate, within the limit; remember it."""
    command = subtract(torque, scale(observer.feedforward, vector(memory.disturbance)))
    command = clamp(command, observer.max_torque)
    store(memory.torque, command)
    return command


def _step_of(law: Component) -> Any:
    """Step of a law behind the observer."""
    step, unarmed = kernel_of(law), np.zeros((), law.state)[()]
    count = law.output_record.itemsize // 8

    def observed(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
        if quaternion(inputs.attitude) == NO_ATTITUDE:
            # Without an attitude the law's errors are unknown, too.
            carray(pointer_to(outputs), count, np.float64)[:] = 0.0
            state.observer.started = 0.0  # its last torque does not act over the gap
            state.observer.blind = 1.0
            return
        if state.observer.blind != 0.0:
            state.observer.blind = 0.0
            state.observer.gaps += 1
            state.law = unarmed
        if configuration.observer.frequency == 0.0:
            state.observer.started = 0.0  # switched on in flight it begins anew, not from long ago
            step(inputs, state.law, configuration.law, outputs)
            return
        rate = observe(
            configuration.observer, state.observer, inputs.stamp_ns, vector(inputs.angular_velocity)
        )
        store(inputs.angular_velocity, rate)
        step(inputs, state.law, configuration.law, outputs)
        torque = compensate(configuration.observer, state.observer, vector(outputs.torque_command))
        store(outputs.torque_command, torque)

    # The machine code is cached where the law's own is; this closure is not cached by itself.
    observed.__module__ = step.__module__
    return numba.njit(error_model="numpy")(observed)


def with_front(law: Component) -> Component:
    """Put the observer before a law, and the disturbance estimate after it."""
    configuration = record_type(("observer", OBSERVER), ("law", law.configuration))

    def configure(values: Mapping[str, Any]) -> Any:
        inner, kept = configured(law, values)
        watches = values["rate_observer"] > 0.0 and not law.observes
        observer = observer_record(values) if watches else np.zeros((), OBSERVER)
        return (filled(configuration, {}, observer=observer, law=inner), *kept)

    def advices(state: Any) -> int:
        told = law.advices(state["law"])
        # After a gap the law counts its advices from zero again, but they are new nevertheless.
        return told and (int(state["observer"]["gaps"]) << 32) + told

    own, names = (*PARAMETERS, INERTIA, MAX_TORQUE), {column.name for column in law.inputs}
    return replace(
        law,
        # A parameter of the same name but declared otherwise stays, so that it is reported.
        parameters=(*own, *(each for each in law.parameters if each not in own)),
        configure=configure,
        configuration=configuration,
        inputs=(*law.inputs, *(column for column in TOLD if column.name not in names)),
        state=record_type(("observer", MEMORY), ("law", law.state)),
        step=_step_of(law),
        advice=lambda state: law.advice(state["law"]),
        advices=advices,
    )
