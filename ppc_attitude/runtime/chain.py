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

"""The components that one node runs at each instant, one after the other."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import isfinite
from typing import Any

from ppc_attitude.runtime.stamps import Values
from ppc_attitude.science.component import Component, read_from_elsewhere
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.part import Part, first_raised


class Chain:
    """Components in their order within an instant; each reads what those before it give.

    Attributes
    ----------
    inputs : tuple of Column
        What none of them gives: it comes from other nodes.

    Raises
    ------
    ConfigurationError
        A parameter is infeasible.
    """

    def __init__(self, components: Sequence[Component], values: Mapping[str, Any]) -> None:
        self.parts: list[Part] = []
        self.configure(components, values)

    def configure(self, components: Sequence[Component], values: Mapping[str, Any]) -> None:
        """Take other parameters from the next instant on; a component that stays keeps its memory.

        Raises
        ------
        ConfigurationError
            A parameter is infeasible.
        """
        known = {part.component: part for part in self.parts}
        self.parts = []
        for component in components:
            if part := known.get(component):
                part.configure(values)
            else:
                part = Part(component, values)
            self.parts.append(part)
        self._reads = [
            (part, [column.name for column in part.component.inputs]) for part in self.parts
        ]
        self.inputs = read_from_elsewhere(components)

    def forget(self) -> None:
        """Begin anew, as at the first step."""
        for part in self.parts:
            part.forget()

    def news(self) -> Iterator[Advice]:
        """Yield the advice that components have given since the last time."""
        for part in self.parts:
            if part.advices != part.told:
                part.told = part.advices
                yield part.advice

    @property
    def numbers(self) -> dict[str, float]:
        """What the components count and measure of themselves, by name with unit."""
        return {name: n for part in self.parts for name, n in part.advice.numbers.items()}

    def not_finite(self, signals: Mapping[str, Values], names: Iterable[str]) -> str:
        """Say which component has given numbers that are not finite, and whether its step failed.

        The text is empty if the numbers of these names are finite. Every peer would refuse others,
        and a run in lock-step would wait for ever.
        """
        if isfinite(sum(map(sum, map(signals.__getitem__, names)))):
            return ""
        for part in self.parts:
            for column in part.places:
                if not all(map(isfinite, signals[column])):
                    told = f"{part.component.name} gives {column} = {signals[column]}"
                    return f"{told}; allowed: finite numbers{first_raised(self.parts)}"
        return ""  # only their sum is too large

    def step(self, stamp_ns: int, inputs: Mapping[str, Values]) -> dict[str, Values]:
        """Run every component once at an instant [ns]; return `inputs` and all that they give."""
        signals = dict(inputs)
        for part, reads in self._reads:
            row = part.step(stamp_ns, [number for name in reads for number in signals[name]])
            for name, place in part.places.items():
                signals[name] = row[place]
        return signals
