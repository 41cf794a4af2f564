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

"""The certificate: two libraries agree, no random state passes a bound, changes void it."""

import json
import math
import re
import tracemalloc
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Ask
from craft_helpers import case, configs, guaranteed, overlay
from docs_helpers import described
from mpmath import iv

from ppc_attitude.analysis.guarantee import nodes_around
from ppc_attitude.command_line import guarantee_view
from ppc_attitude.command_line.guarantee_view import (
    certificate_path,
    stored_certificate,
)
from ppc_attitude.contract.topics import CONTROLLER, PLANT, REFERENCE
from ppc_attitude.processes.exits import REQUIREMENT_FAILED
from ppc_attitude.science.controllers.tube_parameters import CERTIFICATE, digest_of
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.guarantee.arithmetic import FLOATS, Arithmetic, balls
from ppc_attitude.science.guarantee.assumptions import (
    Assumptions,
    Law,
    assumptions_of,
    law_of,
    parameters_of,
)
from ppc_attitude.science.guarantee.bounds import Bounds
from ppc_attitude.science.guarantee.cells import COARSE
from ppc_attitude.science.guarantee.certificate import (
    Certificate,
    certify,
    differences,
    inequalities,
)
from ppc_attitude.science.guarantee.design import Wishes, designed
from ppc_attitude.science.guarantee.envelope import Envelope
from ppc_attitude.science.guarantee.surroundings import (
    broken_assumptions,
    broken_by_reference,
    longer_ramps,
)
from ppc_attitude.science.inertia import inertia_error
from ppc_attitude.science.references.paper import motion_bounds
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import Scenario, load

# Largest time that is promised from 1 deg/s [s], whatever the reference.
SHIPPED = {
    "guaranteed": 92.0,
    "guaranteed_sharp": 90.0,
    "guaranteed_quiet": 96.0,
    "guaranteed_ahead": 105.0,
}


def values_of(name: str = "guaranteed") -> dict[str, Any]:
    return dict(case(name).parameters[CONTROLLER])


def complete(assumed: Assumptions, law: Law) -> dict[str, Any]:
    return values_of() | parameters_of(assumed, law)


def extreme(of: Callable[..., Any], *values: Any) -> Any:
    """Interval of the largest or least of some numbers."""
    pairs = [iv.mpf(each) for each in values]
    return iv.mpf([of(each.a for each in pairs), of(each.b for each in pairs)])


def ends(x: Any) -> tuple[float, float]:
    """Floats below and above an interval, whose ends a conversion may round by half a unit."""
    low, high = float(iv.mpf(x).a), float(iv.mpf(x).b)
    return math.nextafter(low, -math.inf), math.nextafter(high, math.inf)


# The second library: mpmath.
INTERVALS = Arithmetic(
    pi=iv.pi,
    number=iv.mpf,
    sqrt=iv.sqrt,
    sin=iv.sin,
    cos=iv.cos,
    largest=partial(extreme, max),
    least=partial(extreme, min),
    upper=lambda x: iv.mpf(x.b),
    outward=ends,
)


@pytest.mark.parametrize("name", ["guaranteed", "guaranteed_quiet", "guaranteed_ahead"])
def test_a_start_that_is_too_fast_to_cruise_settles_no_sooner_than_one_that_cruises(
    name: str,
) -> None:
    """A promise for a rate holds for all that are slower; it integrates the fast start alone."""
    values = case(name).parameters[CONTROLLER]
    law = law_of(values)
    envelope = Envelope(Bounds(assumptions_of(values), law, FLOATS, COARSE))
    slow, fast = (envelope.settling(law.w_far * each, 5e-3) for each in (1.0 - 1e-9, 1.0 + 1e-9))
    assert slow < fast < slow + 1.0


@cache
def proved(name: str) -> Certificate:
    return certify(values_of(name))


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_certificate_is_proved_again_and_says_no_more(name: str) -> None:
    stored = stored_certificate(configs(name))
    assert stored is not None
    values = values_of(name)
    certificate = proved(name)
    assert certificate.holds
    assert differences(stored, certificate) == []
    assert values[CERTIFICATE.name] == stored["digest"] == digest_of(values)
    times = {each["rate"]: each["time"] for each in stored["promises"]}
    assert times[1.0] <= SHIPPED[name]


def test_a_second_library_proves_the_same() -> None:
    assumed, law = guaranteed()
    count = (40, 2, 2)  # wider cells: a weaker statement, the same formulas
    law = replace(law, brake=(0.034, 0.034, 0.044))
    judged = {}
    for name, arithmetic in (("arb", balls()), ("mpmath", INTERVALS), ("floats", FLOATS)):
        judged[name] = inequalities(Bounds(assumed, law, arithmetic, count))
    for ball, interval, number in zip(*judged.values(), strict=True):
        assert ball.holds is interval.holds is number.holds
        for side in ("left", "right"):
            (low, high), (below, above) = getattr(ball, side), getattr(interval, side)
            middle = getattr(number, side)[0]
            assert max(low, below) <= min(high, above), "both contain the true value"
            slack = 1e-12 * abs(middle)  # floats are rounded at every step
            assert low - slack <= middle <= high + slack


def test_settling_times_of_both_libraries_agree() -> None:
    assumed, law = guaranteed()
    times = []
    for arithmetic in (balls(), INTERVALS, FLOATS):
        envelope = Envelope(Bounds(assumed, law, arithmetic, (40, 1, 1)))
        times.append(envelope.near_time(arithmetic.number(0.2), 0.02, 5e-3))
    assert times[1:] == pytest.approx(times[:1] * 2, rel=1e-12)


def test_what_is_undefined_has_no_bound_and_is_not_proved() -> None:
    assumed, law = guaranteed()
    law = replace(law, omega0=10.0)  # to stop from there takes more than all torque
    judged = inequalities(Bounds(assumed, law, balls(), (40, 2, 2)))
    assert not any(math.isnan(end) for each in judged for end in (*each.left, *each.right))
    unbounded = [each for each in judged if each.left == (-math.inf, math.inf)]
    assert unbounded
    assert not any(each.holds for each in unbounded)


def test_every_assumption_matters() -> None:
    """A worse craft, reference or measurement fails an inequality of the shipped law."""
    assumed, law = guaranteed()
    for change in (
        {"max_torque": 0.049},
        {"dead_band": 2e-4},
        {"d": 4.5e-3},
        {"W": 0.0145},
        {"W1": 7e-4},
        {"W2": 1e-2},
        {"Omega": 0.0523},
        {"eta": 0.99},
        {"e_S": 0.01},
        {"e_W": 1e-6},
        {"e_A": 1e-6},
        {"late": 1.0},
        {"inertia": (2.9, 0.0, 0.0, 0.0, 2.5, 0.0, 0.0, 0.0, 1.9)},
    ):
        certificate = certify(complete(replace(assumed, **change), law), arithmetic=FLOATS)
        assert not certificate.holds, change
        assert certificate.promises == ()


def test_a_quicker_law_has_longer_ramps_and_check_says_so() -> None:
    """With a fifth of the sample time the last tenths of p fell for 0.14 s, not for a sample."""
    ends = []
    for rate in (100.0, 500.0):
        start = {"rate": rate, "initial_angular_velocity": [0.02, -0.01, 0.03]}
        given = load(configs("paper", "guaranteed"), {PLANT: start})
        record = simulate(given, 3.0)
        ends.append(float(record.t[record["phase"][:, 0] == 1.0][-1]))
    assert 0.1 < ends[1] - ends[0] < 0.21
    (told,) = longer_ramps(law_of(given.parameters[CONTROLLER]), nodes_around(given.parameters))
    assert told.startswith("at 500 Hz a stop may end 0.21 s later than at the 100 Hz of the")
    shipped = case("guaranteed")
    assert not [*longer_ramps(guaranteed()[1], nodes_around(shipped.parameters))]


def test_a_changed_number_voids_the_certificate(
    tmp_path: Path, ask: Ask, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guarantee_view, "RATES", ())
    monkeypatch.setattr(guarantee_view, "balls", lambda: FLOATS)
    (file,) = configs("guaranteed")
    stored = json.loads(certificate_path(file).read_text())
    stored["promises"] = stored["promises"][-1:]  # one time is proved anew, and not four
    shipped, changed = tmp_path / "shipped.yaml", tmp_path / "changed.yaml"
    shipped.write_text(file.read_text())
    changed.write_text(file.read_text().replace("kappa: 15.4", "kappa: 15.5"))
    for each in (shipped, changed):
        certificate_path(each).write_text(json.dumps(stored))
    paper = ["check", f"--config={configs('paper')[0]}", "--config"]
    assert "guaranteed: |q_ev,i| < 0.005 from t =" in ask(*paper, shipped).out
    told = ask(*paper, changed, code=1).out
    assert "the certificate does not apply: it was issued for other numbers" in told
    assert "guaranteed: " not in told.partition("nothing is")[0]


@pytest.mark.parametrize(
    "text",
    [
        "[" * 100_000,
        "[]",
        '{"accuracy": [1], "promises": []}',
        '{"digest": "", "accuracy": 0.1, "promises": [], "terminal_error": 0, "inequalities": '
        '[{"name": "C0", "left": [1], "right": [1, 2]}]}',
        '{"digest": "", "accuracy": NaN, "promises": []}',
        '{"digest": "", "accuracy": 1e400, "promises": []}',
        '{"digest": "", "accuracy": 2, "promises": [], "terminal_error": 0, "inequalities": []}',
        '{"digest": "", "accuracy": 0.1, "promises": 5}',
        '{"digest": "", "accuracy": 0.1, "promises": [{"rate": 1}]}',
        '{"digest": "", "accuracy": 0.1, "promises": [{"rate": 1, "time": "\\u001b"}]}',
        f'{{"digest": "", "accuracy": 0.1, "promises": [{{"rate": 1, "time": 1{400 * "0"}}}]}}',
    ],
    ids=lambda text: text[-40:],
)
def test_what_is_no_certificate_is_refused_by_name(tmp_path: Path, text: str) -> None:
    path = tmp_path / "mine.yaml"
    certificate_path(path).write_text(text)
    with pytest.raises(ConfigurationError, match=r"mine.certificate.json is no certificate: "):
        stored_certificate([path])


@pytest.mark.parametrize(
    "values",
    [{"k": 1e-9}, pytest.param({"z_bar": 1e6}, marks=pytest.mark.long), {"assumed.W": 1e3}],
)
def test_of_numbers_out_of_proportion_nothing_is_guaranteed_and_the_rest_is_checked(
    tmp_path: Path, ask: Ask, values: dict[str, float]
) -> None:
    """The law flies with them, so they are no mistake that ends the command."""
    law = {f"momentum_tube.{name}": value for name, value in values.items()}
    files = [*configs("paper", "guaranteed"), overlay(tmp_path / "law.yaml", {CONTROLLER: law})]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        words = ("check", *(f"--config={file}" for file in files))
        out = ask(*words, code=REQUIREMENT_FAILED).out
        page = json.loads(ask(*words, "--json", code=REQUIREMENT_FAILED).out)
    assert "initial attitude error" in out
    assert "nothing is guaranteed:\n  the certificate does not apply: " in out
    assert list(page) == described("check")
    assert not page["guaranteed"]
    why = "h and z_bar are out of proportion|allowed: above W .* with W = 1000 rad/s"
    assert re.search(why, page["doubts"][0])


def test_a_certificate_with_any_other_number_is_found_out() -> None:
    """Only its digest and its times had been compared."""
    stored = json.loads(certificate_path(*configs("guaranteed")).read_text())
    stored["promises"][0]["time"] -= 1.0
    stored["terminal_error"] *= 0.1
    stored["inequalities"][1]["left"][1] *= 0.9
    del stored["inequalities"][-1]
    time, *others = differences(stored, proved("guaranteed"))
    assert re.fullmatch(r"it promises .* s from .* deg/s, [0-9.]+ s can be promised", time)
    proof = proved("guaranteed")
    wrong = replace(proof, inequalities=(replace(proof.inequalities[0], holds=False),))
    assert differences(stored, wrong)[0] == "these inequalities do not hold: C0"
    assert others == [
        "it promises 4.36e-05 in the end, 0.000436 can be promised",
        "it has other numbers than those that are proved: C1 x, C13 φ1; one of an earlier version "
        "needs a new `ppc_attitude design`",
    ]


def test_an_inequality_has_a_name_of_its_own() -> None:
    """Numbers are compared by it; two were "C1 z", of which one could be anything."""
    names = [each.name for each in proved("guaranteed").inequalities]
    assert sorted(set(names)) == sorted(names)


def broken(scenario: Scenario) -> list[str]:
    law, nodes = scenario.parameters[CONTROLLER], nodes_around(scenario.parameters)
    assumed = assumptions_of(law)
    by_craft = broken_assumptions(assumed, law_of(law), nodes)
    return [*by_craft, *broken_by_reference(assumed, nodes, duration=120.0)]


@pytest.mark.parametrize(
    ("node", "values", "told"),
    [
        (PLANT, {"rate": 50.0}, "rate = 50 Hz"),
        (PLANT, {"max_torque": 0.04}, "max_torque = 0.04"),
        (PLANT, {"min_torque": 2e-4}, "min_torque = 0.0002"),
        (PLANT, {"late_command": True}, "late_command = true; assumed"),
        (PLANT, {"rate_noise": 1e-6}, "the rate that the law reads is wrong by up to 5e-06 rad/s"),
        (
            PLANT,
            {"inertia": [2.9, 0, 0, 0, 2.5, 0, 0, 0, 1.9]},
            "error of the inertia = 0.0357; assumed",
        ),
        (REFERENCE, {"amplitude": [0.014, 0.0, 0.0]}, "the reference reaches 0.014"),
    ],
)
def test_a_scenario_outside_the_assumptions_is_named(
    node: str, values: dict[str, Any], told: str
) -> None:
    (found,) = broken(load(configs("paper", "guaranteed"), {node: values}))
    assert told in found


@pytest.mark.parametrize(
    ("overlays", "told"),
    [
        (
            ["sensors_flagship"],
            "the attitude that the law reads is wrong by up to 0.0001939 rad (5 σ)",
        ),
        (["sensors_smallsat", "sensors_uncalibrated"], "the filter's covariance does not contain"),
        (["flexible"], "plant = flexible: whether it keeps the assumed bounds is not known"),
        (["wheels"], "guaranteed torque of the wheels = 0.0482"),
    ],
)
def test_hardware_that_was_not_assumed_is_named(overlays: list[str], told: str) -> None:
    assert told in "; ".join(broken(case("guaranteed", *overlays)))


def test_bounds_of_a_reference_need_no_memory_that_grows_with_the_run() -> None:
    """Every millisecond of the run stood in arrays: a run of some hours needed gigabytes."""
    reference = case().parameters[REFERENCE]
    motion_bounds(reference, 0.0)  # compiled
    tracemalloc.start()
    W, W1, W2 = motion_bounds(reference, 3000.0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1e6
    a, T = np.array(reference["amplitude"]), np.array(reference["period_constant"])
    x, y, z = np.arange(0.0, 3000.0, 0.1) / T[:, None]
    rate = a[:, None] * [np.cos(x), np.sin(y), np.cos(z)]
    bend = (a / T)[:, None] * [np.sin(x), np.cos(y), np.sin(z)]
    assert np.linalg.norm(rate, axis=0).max() == pytest.approx(W, rel=1e-3)
    assert np.linalg.norm(bend, axis=0).max() == pytest.approx(W1, rel=2e-3)
    assert np.linalg.norm(a / T**2) == pytest.approx(W2, rel=1e-12)


def test_inertia_error_is_the_one_of_the_definition() -> None:
    known = np.diag([2.8, 2.5, 1.9])
    S = np.array([[0.05, 0.02, 0.0], [0.02, -0.03, 0.01], [0.0, 0.01, 0.04]])
    root = np.sqrt(known)
    true = root @ (np.eye(3) + S) @ root
    expected = np.abs(np.linalg.eigvalsh(S)).max()
    assert inertia_error(known.ravel(), true.ravel()) == pytest.approx(expected, rel=1e-12)


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize("scale", [1e-2, pytest.param(1e2, marks=pytest.mark.long)])
def test_design_scales_with_the_craft(scale: float) -> None:
    """The same craft in other units of mass: the same gains, momenta scaled, the same times."""
    assumed, law = guaranteed()
    gains = law.h, (law.k, law.kappa, law.ell)
    law = designed(assumed, Wishes(), *gains).law  # on the same cells
    torques = ("max_torque", "dead_band", "d")
    other = replace(
        assumed,
        inertia=tuple(scale * each for each in assumed.inertia),
        **{name: scale * getattr(assumed, name) for name in torques},
    )
    found = designed(other, Wishes(), *gains)
    assert found.law.a_most == pytest.approx(law.a_most, rel=5e-5)
    assert np.array(found.law.brake) == pytest.approx(scale * np.array(law.brake), rel=5e-5)
    assert np.array(found.law.Y) == pytest.approx(scale * np.array(law.Y), rel=5e-5)
    assert certify(complete(other, found.law), rates=(1.0,)).holds
