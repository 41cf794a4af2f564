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

"""A component as it is run: which step that is, and what it tells of its last one."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ppc_attitude.contract.topics import CONTROLLER, INJECTOR
from ppc_attitude.runtime.chain import Chain
from ppc_attitude.science.component import Component
from ppc_attitude.science.environments import orbit
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.hooks import Advice, named
from ppc_attitude.science.kernel import kernel
from ppc_attitude.science.kinds import CONTROLLERS
from ppc_attitude.science.parameter import filled, record_type
from ppc_attitude.science.part import Part, configured, first_raised
from ppc_attitude.science.references import goal
from ppc_attitude.science.signals import APPLIED_TORQUE, ENVIRONMENT_TORQUE
from ppc_attitude.simulation.scenario import check_components, scenario

ENVELOPES = {"attitude_error": "attitude_envelope", "rate_error": "rate_envelope"}


@pytest.mark.parametrize("law", CONTROLLERS.components)
def test_a_law_tells_how_much_of_its_own_envelopes_is_filled(law: str) -> None:
    values = scenario({CONTROLLER: {"controller": law}}).parameters[CONTROLLER]
    part = Part(CONTROLLERS.components[law], values)
    given = part.outputs[0]
    expected = {}
    for error, envelope in ENVELOPES.items():
        if envelope in given.dtype.names:
            given[error][:3], given[envelope] = (0.5, -3.0, 1.0), 2.0
            expected[envelope] = 1.5
    assert part.normalised_errors() == expected


@pytest.mark.parametrize("law", CONTROLLERS.components)
def test_a_law_that_forgets_tells_no_errors_of_before_while_there_is_no_attitude(law: str) -> None:
    """Until the first fix it is not stepped: then it gives what a new one gives."""
    component = CONTROLLERS.components[law]
    values = scenario({CONTROLLER: {"controller": law}}).parameters[CONTROLLER]
    part, new = Part(component, values), Part(component, values)
    width = sum(column.width for column in component.inputs)
    part.step(0, np.linspace(0.1, 0.2, width))
    part.forget()
    assert part.step(0, np.zeros(width)) == new.step(0, np.zeros(width))


def _giving(number: float) -> Any:
    @kernel
    def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
        outputs.environment_torque[0] = number

    return step


@kernel
def _negative(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    outputs.environment_torque[0] = -1.0


ONE = Component(name="mine", outputs=(ENVIRONMENT_TORQUE,), step=_giving(1.0))


@pytest.mark.parametrize("bad", [0.0, math.nan, -math.inf])
def test_numbers_that_are_finite_are_so_whatever_their_sum(bad: float) -> None:
    signals = {ENVIRONMENT_TORQUE.name: (1e308, 1e308, bad)}
    told = Chain([ONE], {}).not_finite(signals, signals)
    assert told.startswith("mine gives environment_torque = (1e+308, 1e+308, ") == bool(bad)


def test_components_of_one_name_and_module_run_their_own_steps() -> None:
    """A name is unique only within a kind."""
    both = [ONE, replace(ONE, step=_negative)]
    chain = Chain(both, {})
    parts = [*chain.parts]
    assert [part.step(0) for part in parts] == [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)]
    chain.configure(both, {})
    assert chain.parts == parts  # with what they remember


def test_a_step_fills_the_records_of_the_component_that_reuses_it() -> None:
    moved = Part(replace(ONE, outputs=(APPLIED_TORQUE, ENVIRONMENT_TORQUE)), {})
    assert Part(ONE, {}).step(0) == (1.0, 0.0, 0.0)
    assert moved.step(0) == (0.0, 0.0, 0.0, 1.0, 0.0, 0.0)


def test_what_is_extended_keeps_the_arrays_to_which_its_record_refers() -> None:
    def made(component: Component) -> tuple[Any, list[Any]]:
        return configured(component, {**component.defaults, **orbit.COMPONENT.defaults})

    more = goal.COMPONENT.extended("more", {"gain": (np.float64, lambda _: 3.0)}, step=_negative)
    record, kept = made(more)
    assert record["gain"] == 3.0
    assert record["address"] == kept[0].ctypes.data
    assert [each.dtype for each in kept] == [each.dtype for each in made(goal.COMPONENT)[1]]


def test_components_that_only_what_their_steps_enclose_tells_apart_run_their_own() -> None:
    parts = [Part(replace(ONE, step=_giving(number)), {}) for number in (1.0, 2.0)]
    assert [part.step(0)[0] for part in parts] == [1.0, 2.0]


@kernel
def _counting(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    configuration.gain += 1.0
    outputs.environment_torque[0] = configuration.gain


def test_what_a_step_writes_to_its_configuration_does_not_outlast_the_run() -> None:
    """Else the numbers of a campaign's run would depend on the runs before it."""
    kind = record_type(("gain", np.float64))
    made = {"configuration": kind, "configure": lambda values: filled(kind, {"gain": 1.0})}
    part = Part(replace(ONE, step=_counting, **made), {})
    assert [part.step(0)[0], part.step(0)[0]] == [2.0, 3.0]
    part.forget()
    assert part.step(0)[0] == 2.0


@kernel
def _raising(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    outputs.environment_torque[0] = 1.0
    if inputs.t > 0.5:
        raise ValueError("beyond my table")


def test_a_step_that_raises_gives_no_numbers_and_says_why_when_it_is_asked() -> None:
    """Whoever calls machine code by its address hears of no error."""
    part = Part(replace(ONE, step=_raising), {})
    assert part.step(0) == (1.0, 0.0, 0.0)
    assert part.raised() == first_raised([part]) == ""
    assert all(map(math.isnan, part.step(1_000_000_000)))
    assert part.raised() == "raised ValueError: beyond my table"
    assert first_raised([part]).endswith("component mine raised ValueError: beyond my table")


def _uncompiled(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    outputs.environment_torque[0] = 1.0


@kernel
def _of_two(inputs: Any, outputs: Any) -> None:
    outputs.environment_torque[0] = 1.0


@kernel
def _elsewhere(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    outputs.nowhere[0] = 1.0


@kernel
def _mistyped(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    outputs.environment_torque[0] = "a" * inputs.t


@pytest.mark.parametrize(
    ("step", "told"),
    [
        (_uncompiled, "= <function _uncompiled"),
        (_of_two, "takes inputs, outputs; allowed: inputs, state, configuration, outputs"),
        (_elsewhere, "cannot be compiled: KeyError: 'nowhere'"),
        (_mistyped, "cannot be compiled: "),
    ],
)
def test_a_step_that_cannot_be_compiled_is_told_with_its_component(step: Any, told: str) -> None:
    with pytest.raises(ConfigurationError, match=f"(?s)^component mine: step {told}[^\x1b]*$"):
        Part(replace(ONE, step=step), {})


def _exits(values: Any) -> None:
    raise SystemExit(5)


def _panics(values: Any) -> Any:
    raise BaseException("a Rust extension raises such a one")


def _refuses(values: Any) -> None:
    raise ConfigurationError("gain = 0; allowed: > 0")


@pytest.mark.parametrize(
    ("configure", "told"),
    [
        (lambda values: values["gain"], "component mine: configure raised KeyError: 'gain'"),
        (_exits, "component mine: configure raised SystemExit: 5"),
        (_panics, "component mine: configure raised BaseException: a Rust extension"),
        (lambda values: (), r"component mine: configure made \(\), which is no record of"),
        (lambda values: None, "component mine: configure made None, which is no record of"),
        (lambda values: np.zeros(()), r"component mine: configure made array\(0.\), which is no"),
        (_refuses, "gain = 0; allowed: > 0"),
    ],
)
def test_a_configuration_that_cannot_be_made_is_told_with_its_component(
    configure: Any, told: str
) -> None:
    with pytest.raises(ConfigurationError, match=f"^{told}"):
        Part(replace(ONE, configure=configure), {})


@pytest.mark.parametrize(
    ("numbers", "field"),
    [(((math.nan,), (1.0, 2.0)), "more.nothing"), (((1.0,), (2.0, math.nan)), "last")],
)
def test_a_number_that_is_none_is_refused_wherever_it_is_in_a_record(
    numbers: Any, field: str
) -> None:
    pair = record_type(("more", ONE.configuration), ("last", np.float64, (2,)))
    made = {"configuration": pair, "configure": lambda values: np.array(numbers, pair)[()]}
    with pytest.raises(ConfigurationError, match=f"mine: configure made {field} = NaN; allowed"):
        configured(replace(ONE, **made), {})


@pytest.mark.parametrize(
    "hook", ["advice", "advices", "exact", "torque", "faults", "least_impulse", "period", "bound"]
)
def test_a_hook_that_raises_is_told_with_its_component(hook: str) -> None:
    ours = replace(ONE, name="ours", **{hook: lambda given: given["wheels"]})
    broken = replace(ours, name="mine")
    with pytest.raises(ConfigurationError, match=f"^component mine: {hook} raised KeyError: 'whe"):
        getattr(broken, hook)({})


@pytest.mark.parametrize(
    ("hook", "answer", "told"),
    [
        ("bound", math.nan, "ValueError: nan; allowed: a number ≥ 0"),
        (
            "least_impulse",
            -1.0,
            "ValueError: -1.0; allowed: finite numbers .N·m·s., three for each",
        ),
        ("least_impulse", [[0.1, math.nan, 0.0]], "ValueError: .*nan.*; allowed: finite numbers"),
        ("torque", (1.0,), "ValueError: not enough values"),
        ("torque", (1.0, None), "TypeError: float.* not 'NoneType'"),
        ("torque", (2.0, 1.0), r"ValueError: \(2.0, 1.0\); allowed: a certain torque up to the l"),
        ("faults", None, "TypeError: 'NoneType' object is not iterable"),
        (
            "faults",
            {"my wheel": ()},
            r"ValueError: 'my wheel': \(\); allowed: a name without space",
        ),
        ("faults", {"wheel": "seized"}, "ValueError: 'wheel': 'seized'; allowed: .* and Failures"),
        ("advice", Advice(None, warning=False), r"TypeError: Advice\(text=None, .* with a text"),  # type: ignore[arg-type]
        ("advices", "many", "ValueError: invalid literal"),
        ("advice", "all is well", "TypeError: 'all is well'; allowed"),
        ("conditions", (0.1, 0.2), r"TypeError: \(0.1, 0.2\); allowed: Conditions"),
        ("conditions", None, "TypeError: 'NoneType' object is not iterable"),
        ("motion_bounds", (0.1, 0.2), "ValueError: not enough values"),
        ("motion_bounds", (0.1, -0.2, 0.3), "ValueError: -0.2; allowed: a number ≥ 0"),
    ],
)
def test_an_answer_that_is_none_is_told_with_its_component(
    hook: str, answer: Any, told: str
) -> None:
    broken = replace(ONE, **{hook: lambda *given: answer})
    with pytest.raises(ConfigurationError, match=f"^component mine: {hook} raised {told}"):
        getattr(broken, hook)({})


@pytest.mark.parametrize("hook", ["advice", "advices"])
def test_a_part_whose_words_fail_goes_on_and_warns_of_it(hook: str) -> None:
    def fails(state: Any) -> Any:
        raise KeyError("sum")

    chain = Chain([replace(ONE, advices=lambda state: 1)], {})
    chain.parts[0].component = replace(chain.parts[0].component, **{hook: fails})
    told = Advice(f"component mine: {hook} raised KeyError: 'sum'", warning=True)
    assert [*chain.news(), *chain.news()] == [told]
    assert chain.numbers == {}


@pytest.mark.parametrize("hook", ["configure", "advice", "torque", "faults"])
def test_a_hook_that_raises_is_told_with_its_node_before_anything_runs(
    monkeypatch: pytest.MonkeyPatch, hook: str
) -> None:
    """Of a torque that cannot be told: else a run would be judged by the limit of its law."""
    broken = replace(ONE, **{hook: lambda given: given["wheels"]})
    monkeypatch.setattr(f"{check_components.__module__}.components_of", lambda *_: (broken,))
    told = f"^{INJECTOR}: component mine: {hook} raised "
    with pytest.raises(ConfigurationError, match=told):
        check_components(INJECTOR, {})


def test_numbers_that_are_none_are_refused_where_the_component_gives_them() -> None:
    """Only the nodes send them: a run ended in a traceback that the loop knew nothing of."""
    for numbers in ({"a": "b"}, {"a": None}, {3: 1.0}):
        given = Advice("", False, numbers=numbers)  # type: ignore[arg-type]
        with pytest.raises(ConfigurationError, match="component mine: advice raised"):
            named("mine", "advice", lambda _, given=given: given)(None)
