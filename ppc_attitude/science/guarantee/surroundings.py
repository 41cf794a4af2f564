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

"""Whether a scenario lies within what a certificate assumes, as far as its parameters tell."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from operator import itemgetter
from typing import Any

import numpy as np

from ppc_attitude.science.controllers.momentum_tube import LANDED
from ppc_attitude.science.controllers.tube_parameters import LAW_AHEAD
from ppc_attitude.science.disturbances.pulses import scheduled_pulses
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.estimators import mekf
from ppc_attitude.science.estimators.steady_state import first_knowledge
from ppc_attitude.science.faults import FAULTS, fault_texts
from ppc_attitude.science.guarantee.arithmetic import FLOATS
from ppc_attitude.science.guarantee.assumptions import Assumptions, Law
from ppc_attitude.science.guarantee.body import Body
from ppc_attitude.science.guarantee.fixed_point import TUMBLING
from ppc_attitude.science.guarantee.nodes import (
    HARDWARE,
    KNOWN,
    Nodes,
    actuation_of,
    first_momentum,
    has_wheels,
    held_momentum,
)
from ppc_attitude.science.inertia import inertia_error
from ppc_attitude.science.kinds import ENVIRONMENTS, REFERENCES
from ppc_attitude.science.plants import rigid_body
from ppc_attitude.science.sensors.star_tracker import INITIAL_FIX, slots
from ppc_attitude.science.stamps import instant, seconds

_HORIZON = 3600.0  # [s] for which a design looks at the reference, unless a run is longer
_DOUBT = "whether it keeps the assumed bounds is not known"
_NOISE = 6.0  # deviations that a design takes as the bound of an estimation error
LEAD = 0.6  # [rad] beyond half a turn for a law that knows what lies ahead: the paper's needs 0.55
_ROUNDING = 1e-12  # relative, of an inertia
TUBE = 0.03
"""Share of the largest omega0 that a design first takes for the rate error in the tube."""
DEVIATIONS = 5.0
"""σ beyond which a Gaussian error breaks an assumption; a design leaves room: `_NOISE` of them."""
# What a filter cannot know of its sensors: its covariance says nothing of these errors.
_UNSEEN = (
    "gyro.scale_factor",
    "gyro.misalignment",
    "gyro.scale_factor_sigma",
    "gyro.misalignment_sigma",
    "star_tracker.outlier_probability",
)


def broken_assumptions(assumed: Assumptions, law: Law, nodes: Nodes) -> Iterator[str]:
    """Yield each assumption of a certified law that craft and environment do not keep.

    Both numbers are told: the assumed one, and what the parameters of the nodes say.
    """
    plant = nodes.plant
    if 1.0 / plant["rate"] > law.h * (1 + 1e-9):
        yield f"rate = {plant['rate']:g} Hz; the certificate is for at least {1.0 / law.h:g} Hz"
    fastest = fastest_of(assumed, law)
    actuator = actuation_of(plant, assumed.momentum, fastest, assumed.max_torque)
    error = inertia_error(np.array(assumed.inertia), actuator.inertia)
    if error > assumed.e_S + _ROUNDING:
        yield f"relative error of the inertia = {error:.3g}; assumed: at most e_S = {assumed.e_S:g}"
    if actuator.torque < assumed.eta * assumed.max_torque:
        yield (
            f"{actuator.told} = {actuator.torque:g} N·m; "
            f"assumed: at least {assumed.eta * assumed.max_torque:g}"
        )
    if actuator.dead_band > assumed.dead_band:
        yield f"min_torque = {actuator.dead_band:g} N·m; assumed: at most {assumed.dead_band:g}"
    if actuator.late and assumed.late < 1.0:
        yield "late_command = true; assumed: a command acts with its own sample (late = 0)"
    attitude, rate = _deviations(nodes)
    lag = _rate_lag(nodes, assumed, fastest)
    for name, error, bound, unit in (
        ("attitude", DEVIATIONS * attitude, assumed.e_A, "rad"),
        ("rate", DEVIATIONS * rate + lag, assumed.e_W, "rad/s"),
    ):
        if error > bound:
            yield (
                f"the {name} that the law reads is wrong by up to {error:.4g} {unit} "
                f"({DEVIATIONS:g} σ); "
                f"assumed: at most {bound:g}"
            )
    doubtful = [nodes.unknown(kind) for kind in HARDWARE]
    doubtful += [f"{FAULTS.name} = {text!r}" for text in fault_texts(plant)]
    torque = nodes.torque_bound
    if torque is None:
        doubtful.append(nodes.told(ENVIRONMENTS))
    for found in filter(None, doubtful):
        yield f"{found}: {_DOUBT}"
    if torque is not None and assumed.d < torque + actuator.rest:
        beside = f" and the wheels' residual {actuator.rest:.4g} N·m" if actuator.rest else ""
        yield f"the environment reaches {torque:.4g} N·m{beside}; assumed: d = {assumed.d:g}"
    if nodes.estimated:
        yield from _unseen(plant, nodes.estimator)
        sigma, bias = plant["gyro.initial_bias_sigma"], np.abs(plant["gyro.initial_bias"])
        measured = fastest + float(bias.max()) + DEVIATIONS * sigma
        if plant["gyro.full_scale"] < measured:
            yield (
                f"gyro.full_scale = {plant['gyro.full_scale']:g} rad/s; the promised rates and "
                f"the gyro's bias need at least {measured:.4g} rad/s"
            )


def broken_by_reference(assumed: Assumptions, nodes: Nodes, duration: float) -> Iterator[str]:
    """Yield each assumption that the reference may not keep for a duration [s].

    A record shows by itself what the reference did.
    """
    bounds = nodes.motion_bounds(duration)
    if math.inf in bounds:
        yield f"{nodes.told(REFERENCES)}: {_DOUBT}"
    for name, value in zip(("W", "W1", "W2"), bounds, strict=True):
        if getattr(assumed, name) < value < math.inf:
            yield f"the reference reaches {value:.4g}; assumed: {name} = {getattr(assumed, name):g}"


def longer_ramps(law: Law, nodes: Nodes) -> Iterator[str]:
    """Yield by how much the times are longer with samples shorter than those of the certificate.

    In a sample a ramp makes at most the share h'/h of what is left, with the true h' ≤ h. So its
    end falls as e^{−t/h}, down to the share at which the law takes it for landed.
    """
    rate = nodes.plant["rate"]
    if rate * law.h > 1.0 + 1e-9:
        more = math.log(1.0 / LANDED) * law.h
        yield (
            f"at {rate:g} Hz a stop may end {more:.2g} s later than at the {1.0 / law.h:g} Hz of "
            "the certificate: add that to its times, or design for this rate"
        )


def suspensions(assumed: Assumptions, nodes: Nodes, duration: float) -> Iterator[str]:
    """Yield what may suspend the promise in a flight of some duration [s].

    Without fixes the filter's covariance grows beyond the assumed errors, and the torque of the
    environment lets the momentum of a craft with wheels grow, beyond what they can hold. A
    scheduled pulse adds to that torque, beyond the assumed one.
    """
    plant, torque = nodes.plant, nodes.torque_bound
    yield from _hit(assumed, nodes, duration)
    if has_wheels(plant):
        first = first_momentum(plant, plant[rigid_body.INITIAL_RATE.name])
        last = math.inf if torque is None else first + torque * duration
        if last > assumed.momentum:
            yield (
                f"the promise holds while the momentum is at most {assumed.momentum:.4g} N·m·s: it "
                f"is {first:.4g} at the start, and may be {last:.4g} after {duration:g} s"
            )
        most = held_momentum(plant)
        if most < assumed.momentum:
            yield (
                f"in some direction the wheels hold no more than {most:.4g} N·m·s: the promise "
                f"ends there, and not at the assumed momentum of {assumed.momentum:.4g} N·m·s"
            )
    if not nodes.estimated:
        return
    held = "the promise holds while fixes come: star_tracker."
    if not plant[INITIAL_FIX.name]:
        first = slots(plant["rate"], plant)[1] / plant["rate"]
        yield (
            f"no fix comes before {first:g} s ({INITIAL_FIX.name} = false): the promised times "
            "begin with the first fix, from the rate that the craft has by then"
        )
    most = plant["star_tracker.max_rate"]
    promised = TUMBLING[0] * assumed.Omega + assumed.W  # ‖ω_s‖ of the fastest start of any law
    if most < promised:
        yield f"{held}max_rate = {most:.4g} rad/s is below the promised {promised:.4g} rad/s"
    for name in ("blinding_times", "dropout_probability"):
        if plant[f"star_tracker.{name}"]:
            yield f"{held}{name} = {plant[f'star_tracker.{name}']} removes some"


def _hit(assumed: Assumptions, nodes: Nodes, duration: float) -> Iterator[str]:
    """Yield which scheduled pulse is the first that may be beyond the assumed disturbance."""
    pulses = scheduled_pulses(nodes.injector)
    for hit in sorted(pulses, key=itemgetter("start_ns")):
        at = seconds(int(hit["start_ns"]))
        together = [each for each in pulses if each["start_ns"] <= hit["start_ns"] < each["end_ns"]]
        torque = float(np.abs([each["torque"] for each in together]).sum(axis=0).max())
        reached = torque + (nodes.torque_bound or 0.0)
        if at < duration and reached > assumed.d:
            yield (
                f"the disturbance may reach {reached:.4g} N·m from {instant(at)} s on, by a "
                f"scheduled pulse; assumed: d = {assumed.d:g}. The promise begins anew after each "
                "such hit"
            )
            return


def fastest_of(assumed: Assumptions, law: Law) -> float:
    """Largest ‖ω_s‖ [rad/s] for which a promise exists: after an event, or later."""
    errors = assumed.e_W + assumed.W * assumed.e_A
    return max(law.omega0 + errors + law.z_bar + assumed.W, assumed.Omega)


def tube_of(assumed: Assumptions, law: Law) -> float:
    """Return the `tube` with which `assumptions_from` takes `fastest_of` for the largest rate."""
    return (fastest_of(assumed, law) - assumed.W) / (TUMBLING[0] * assumed.Omega) - 1.0


def _deviations(nodes: Nodes) -> tuple[float, float]:
    """σ of what the law is told, attitude [rad] and rate [rad/s], on its worst axis.

    An estimator is taken as it begins, with its first fix, because what it knows only grows.
    """
    plant = nodes.plant
    if not nodes.estimated:
        return float(plant["attitude_noise"]), float(plant["rate_noise"])
    attitude, bias, white = first_knowledge(nodes.estimator, plant["rate"])
    return math.sqrt(attitude), math.sqrt(white**2 * plant["rate"] + bias)


def white_noise(nodes: Nodes) -> tuple[float, float]:
    """σ of the attitude [rad] and rate [rad/s] that the law is told, from sample to sample.

    What a filter knows of attitude and bias wanders slowly; the gyro's noise comes through.
    """
    if not nodes.estimated:
        return _deviations(nodes)
    rate = nodes.plant["rate"]
    _, _, white = first_knowledge(nodes.estimator, rate)
    return 0.0, white * math.sqrt(rate)


def _rate_lag(nodes: Nodes, assumed: Assumptions, fastest: float) -> float:
    """Largest difference of a gyro's mean rate of a step from the rate at its end [rad/s]: h ω'/2.

    J ω' = τ + d − ω × Jω, with ‖ω‖ up to the fastest [rad/s] of what is promised. J differs from Ĵ
    by ‖S‖ ≤ e_S: so ω × Jω by at most e_S λ_max ‖ω‖², and J⁻¹y from Ĵ⁻¹y by at most ε ‖Ĵ⁻¹y‖.
    """
    if not nodes.estimated:
        return 0.0
    body = Body(assumed, FLOATS)
    squared = fastest**2
    torque = assumed.max_torque + assumed.d + assumed.e_S * body.most * squared
    turned = body.box(tuple(torque + each * squared for each in body.spread))
    off = body.inverse_error(assumed.e_S)
    return float(0.5 / nodes.plant["rate"] * (1.0 + off) * turned)


def _unseen(plant: Mapping[str, Any], estimator: Mapping[str, Any]) -> Iterator[str]:
    """Yield what the filter does not know of its sensors, so that its covariance is too small."""
    for name in _UNSEEN:
        if np.any(plant[name]):
            yield f"{name} = {plant[name]}: the filter's covariance does not contain it"
    bias, sigma = plant["gyro.initial_bias"], estimator["gyro.initial_bias_sigma"]
    if np.abs(bias).max() > sigma:  # the seed may add some σ to a fixed part
        yield f"gyro.initial_bias = {bias} rad/s; the filter takes σ = {sigma:g} for the whole bias"
    for each in mekf.PARAMETERS:
        if plant.get(each.name, estimator[each.name]) != estimator[each.name]:
            yield (
                f"{each.name} = {plant[each.name]} in the plant; the filter takes it for "
                f"{estimator[each.name]}"
            )


def assumptions_from(
    nodes: Nodes, controller: Mapping[str, Any], declared: Mapping[str, float], tube: float = TUBE
) -> Assumptions:
    """Read from the nodes' parameters what a design may assume.

    Parameters
    ----------
    nodes : Nodes
        Nodes around the law.
    controller : mapping
        Checked parameters of its node.
    declared : mapping of str to float
        Assumptions by name that replace those from the parameters.
    tube : float
        Fraction of the largest omega0 that the rate error may have in the tube.

    Raises
    ------
    ConfigurationError
        A selected component has no bounds that are known here, or hardware fails.
    """
    plant = nodes.plant
    for kind in HARDWARE:
        if found := nodes.unknown(kind):
            raise ConfigurationError(
                f"{found}: no bounds are known of it, so nothing can be guaranteed; allowed: "
                + ", ".join(each.name for each in KNOWN[kind.name])
            )
    for text in fault_texts(plant):
        raise ConfigurationError(
            f"{FAULTS.name}: {text!r}: nothing can be guaranteed of it; allowed: no faults"
        )
    sigma_A, sigma_W = _deviations(nodes)
    W, W1, W2 = nodes.motion_bounds(max(_HORIZON, plant["duration"]))
    d = nodes.torque_bound
    bounds = {"W": W, "W1": W1, "W2": W2, "d": math.inf if d is None else d}
    for name, bound in bounds.items():
        if math.isinf(bound) and name not in declared:
            source = nodes.told(ENVIRONMENTS if name == "d" else REFERENCES)
            raise ConfigurationError(
                f"{source} tells no bound {name}: give it with --assume {name}=VALUE"
            )
    Omega = declared.get("Omega", math.radians(3.0))
    momentum = 0.0
    if has_wheels(plant):  # with any start up to Ω, for the time of a run
        whole = np.linalg.eigvalsh(np.reshape(plant["inertia"], (3, 3)))[-1] * Omega
        momentum = _raised(
            whole + first_momentum(plant, np.zeros(3)) + (d or 0.0) * plant["duration"]
        )
    momentum = declared.get("momentum", momentum)
    fastest = (1.0 + tube) * TUMBLING[0] * Omega + declared.get("W", _raised(W))
    actuator = actuation_of(plant, momentum, fastest, controller["max_torque"])
    if actuator.torque <= 0.0:
        raise ConfigurationError(
            f"with a momentum of {momentum:g} N·m·s at up to {fastest:.4g} rad/s the wheels give "
            "no torque for certain; allowed: wheels with more torque, less momentum or a lower "
            "rate (--assume momentum=VALUE, Omega=VALUE)"
        )
    error = inertia_error(np.array(controller["inertia"]), actuator.inertia)
    told = {
        "dead_band": actuator.dead_band,
        "d": (d or 0.0) + actuator.rest,
        "momentum": momentum,
        "W": _raised(W),
        "W1": _raised(W1),
        "W2": _raised(W2),
        "Omega": Omega,
        "eta": 1.0,
        "e_S": _raised(error) if error > _ROUNDING else 0.0,
        "e_A": _NOISE * sigma_A,
        "e_W": _NOISE * sigma_W,
        "late": float(actuator.late),
        "lead": LEAD if controller["controller"] == LAW_AHEAD else 0.0,
    }
    assumed = Assumptions(
        inertia=tuple(controller["inertia"]),
        max_torque=min(actuator.torque, controller["max_torque"]),
        **{**told, **declared},
    )
    if "e_W" in declared:
        return assumed
    return replace(assumed, e_W=assumed.e_W + _rate_lag(nodes, assumed, fastest))


def _raised(value: float) -> float:
    """Round up to four digits, so that a file says what was used."""
    if value in (0.0, math.inf):
        return value
    unit = 10.0 ** (math.floor(math.log10(value)) - 3)
    return float(f"{math.ceil(value / unit) * unit:.4g}")
