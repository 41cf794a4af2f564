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

"""Time: stamps are whole nanoseconds, formulas take seconds, and these are the conversions."""

from ppc_attitude.science.errors import ConfigurationError

NANOSECONDS = 1_000_000_000
LARGEST_STEP = 10 * NANOSECONDS  # [ns] between two stamps; after a larger gap time begins anew
ROUNDING = 1  # [ns] by which two stamps may be nearer or further apart than the time between them
LATEST = 1e8  # [s] that any run reaches: no stamp is later, and nothing is scheduled for later


def seconds(stamp_ns: int) -> float:
    """Time of a stamp [s]: the one conversion that every time-dependent formula uses."""
    return stamp_ns * 1e-9


def instant(time: float) -> str:
    """Write a time of a run [s]: with nine digits, because six do not tell seconds of months."""
    return f"{time:.9g}"


def nanoseconds(time: float) -> int:
    """Whole nanoseconds of a time [s]."""
    # Times a float: text from a bag is refused, where an integer would make a billion copies of it.
    return round(time * float(NANOSECONDS))


def span(start: float, duration: float) -> tuple[int, int]:
    """First instant [ns] in a span that starts [s] and lasts [s], and first one after it."""
    # The sum is rounded as stamps are: start and duration, each rounded, may end a nanosecond late.
    return nanoseconds(start), nanoseconds(start + duration)


def stamp_of(step: int, rate: float) -> int:
    """Stamp [ns] of a step of a loop that runs at `rate` [Hz]."""
    # In floats, as a kernel's integers overflow: at 1 kHz they would do so after 107 days.
    return round(step * float(NANOSECONDS) / rate)


def step_of(stamp_ns: int, rate: float) -> int:
    """Step of a stamp [ns]: the inverse of `stamp_of`."""
    return int(stamp_ns * rate / NANOSECONDS + 0.5)


def first_step(stamp_ns: int, rate: float) -> int:
    """First step whose stamp is not before an instant [ns]."""
    nearest = step_of(stamp_ns, rate)
    return nearest + (stamp_of(nearest, rate) < stamp_ns)


def whole_steps(name: str, period: float, rate: float) -> int:
    """Steps of a parameter's period [s] in a loop that runs at `rate` [Hz].

    Raises
    ------
    ConfigurationError
        They are no whole number.
    """
    steps = round(period * rate)
    if steps < 1 or abs(period * rate - steps) > 1e-9 * steps:
        raise ConfigurationError(
            f"{name} = {period!r} s is {period * rate:.12g} steps at rate = {rate!r} Hz; allowed: "
            f"a whole number of steps, the nearest is {max(steps, 1) / rate!r} s"
        )
    return steps
