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

"""`Verdict`: what was judged, how it came out, and how it is told (terminal, JSON)."""

from dataclasses import asdict, dataclass
from typing import Any

NOT_JUDGED = "not shown"


@dataclass(frozen=True)
class Requirement:
    """One requirement and whether it is met.

    Attributes
    ----------
    name : str
        What is required.
    value : float or None
        What the run reached; None if the record cannot show it (then it is not met).
    limit : float
        What the value may reach.
    unit : str
        Unit of both; empty for a number of things.
    met : bool
        True if the run meets it.
    strict : bool
        True if the value must stay below the limit, False if it may equal it.
    """

    name: str
    value: float | None
    limit: float
    unit: str
    met: bool
    strict: bool

    @classmethod
    def judged(
        cls, name: str, value: float | None, limit: float, unit: str, *, strict: bool = False
    ) -> "Requirement":
        """Compare a value with its limit; a value that is not known meets nothing."""
        met = value is not None and (value < limit if strict else value <= limit)
        return cls(name, value, limit, unit, met, strict)

    @property
    def value_text(self) -> str:
        """The value for a reader, without its unit."""
        return NOT_JUDGED if self.value is None else number_text(self.value)

    @property
    def limit_text(self) -> str:
        """The limit for a reader, with its unit."""
        return f"{'<' if self.strict else '≤'} {number_text(self.limit)} {self.unit}".rstrip()


@dataclass(frozen=True)
class Disturbance:
    """One sudden disturbance and the recovery from it.

    Attributes
    ----------
    start_s, duration_s : float
        When it acted [s].
    torque : tuple of 3 float
        Extra torque in body axes [N·m].
    recovery_time_s : float or None
        From its start to the last instant, before the next one or the end, at which the attitude
        error is 5e-3 or more; 0 if it never is, None if it still is at the last instant.
    """

    start_s: float
    duration_s: float
    torque: tuple[float, float, float]
    recovery_time_s: float | None


@dataclass(frozen=True)
class Metrics:
    """The numbers of a run; None where the record cannot show one.

    Attributes
    ----------
    settling_time_s : float or None
        Last instant before the first sudden disturbance at which max_i |q_ev,i| ≥ 5e-3; 0 if none.
    error_after_settling_deadline : float or None
        Largest max_i |q_ev,i| from 60 s on, without the 10 s that follow the start of a sudden
        disturbance.
    terminal_error : float or None
        Largest max_i |q_ev,i| of the last 20 s.
    max_rate_deg_s, max_rate_axis_deg_s : float or None
        Largest ‖ω_s‖ and largest component before the first sudden disturbance.
    max_applied_torque : float
        Largest component of the actuator torque [N·m].
    time_outside_attitude_envelope_s, time_outside_rate_envelope_s : float or None
        Time with a component beyond its envelope; None without an envelope.
    disturbances : tuple of Disturbance
        The sudden disturbances, by start.
    """

    settling_time_s: float | None
    error_after_settling_deadline: float | None
    terminal_error: float | None
    max_rate_deg_s: float | None
    max_rate_axis_deg_s: float | None
    max_applied_torque: float
    time_outside_attitude_envelope_s: float | None
    time_outside_rate_envelope_s: float | None
    disturbances: tuple[Disturbance, ...]


@dataclass(frozen=True)
class Verdict:
    """The judgement of one run.

    Attributes
    ----------
    source : str
        Where the record comes from: the bag's path, or ``simulate``.
    controller : str
        Name of the control law.
    duration_s : float
        From the first instant to the last [s].
    steps : int
        Number of instants.
    missing_messages : int
        How many messages are missing.
    requirements : tuple of Requirement
        Those that apply to this run.
    metrics : Metrics
        The numbers behind them.
    """

    source: str
    controller: str
    duration_s: float
    steps: int
    missing_messages: int
    requirements: tuple[Requirement, ...]
    metrics: Metrics

    @property
    def all_met(self) -> bool:
        """True if the run meets every requirement that applies to it."""
        return all(requirement.met for requirement in self.requirements)

    def to_json(self) -> dict[str, Any]:
        """Return the object that ``ppc_attitude analyse --json`` prints."""
        metrics = asdict(self.metrics)
        for disturbance in metrics["disturbances"]:
            disturbance["torque"] = list(disturbance["torque"])
        return {
            "bag": self.source,
            "controller": self.controller,
            "duration_s": self.duration_s,
            "steps": self.steps,
            "missing_messages": self.missing_messages,
            "requirements": [
                {
                    "name": requirement.name,
                    "value": requirement.value,
                    "limit": requirement.limit,
                    "unit": requirement.unit,
                    "pass": requirement.met,
                }
                for requirement in self.requirements
            ],
            "metrics": {**metrics, "disturbances": list(metrics["disturbances"])},
        }


def verdict_table(verdict: Verdict) -> str:
    """Tell the verdict to a terminal.

    Parameters
    ----------
    verdict : Verdict
        The judgement of one run.

    Returns
    -------
    str
        Lines without a final line break: what was judged, a table of requirements, disturbances.
    """
    head = (
        f"{verdict.source}: controller {verdict.controller}, {verdict.duration_s:g} s, "
        f"{verdict.steps} instants, {verdict.missing_messages} missing messages"
    )
    cells = [("requirement", "value", "limit", "verdict")]
    cells += [
        (each.name, each.value_text, each.limit_text, "met" if each.met else "NOT MET")
        for each in verdict.requirements
    ]
    name, value, limit, _ = (max(len(row[k]) for row in cells) for k in range(4))
    lines = [head, ""]
    lines += [f"{row[0]:<{name}}  {row[1]:>{value}}  {row[2]:<{limit}}  {row[3]}" for row in cells]
    lines.insert(3, "-" * max(len(line) for line in lines[2:]))
    lines += [disturbance_text(each) for each in verdict.metrics.disturbances]
    return "\n".join(lines)


def disturbance_text(disturbance: Disturbance) -> str:
    """One sudden disturbance in one line."""
    torque = ", ".join(number_text(each) for each in disturbance.torque)
    recovery = disturbance.recovery_time_s
    outcome = "not recovered" if recovery is None else f"recovered after {recovery:.4g} s"
    return (
        f"sudden disturbance at {disturbance.start_s:g} s, ({torque}) N·m "
        f"for {disturbance.duration_s:g} s: {outcome}"
    )


def number_text(value: float) -> str:
    """Write a number as a reader wants it: four digits."""
    return f"{value:.4g}"
