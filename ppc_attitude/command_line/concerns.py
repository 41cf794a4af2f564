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

"""Warnings of a run in one process, on standard error; with `run` they are in the nodes' log."""

import sys

import numpy as np

from ppc_attitude.analysis.truth import truth_of
from ppc_attitude.contract.cdr import LARGEST
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.processes.exits import RunError
from ppc_attitude.science.stamps import instant
from ppc_attitude.simulation.closed_loop import raised_until
from ppc_attitude.simulation.news import concerns
from ppc_attitude.simulation.scenario import Scenario


def first_lost(record: RunRecord) -> int:
    """Index of the first instant with a rate beyond any craft's; the number of instants if none."""
    rates = record[truth_of(record).angular_velocity]
    kept = np.abs(rates).sum(axis=1) <= LARGEST  # false for NaN, too
    return int(kept.size if kept.all() else kept.argmin())


def tell_concerns(scenario: Scenario, record: RunRecord) -> None:
    """Print what components warned of in a run, and when, as long as its rate is possible."""
    for time, advice in concerns(scenario, record.stamps_ns[: first_lost(record)]):
        kind = "error: " if advice.failed else "warning: " if advice.warning else ""
        print(f"{kind}at t = {time:.3f} s {advice.text}", file=sys.stderr)


def see_that_it_is_bounded(scenario: Scenario, record: RunRecord) -> None:
    """See that no rate is larger than a craft can have, where the plant of `run` would end.

    Raises
    ------
    RunError
        A rate is; the message says when.
    """
    lost = first_lost(record)
    if lost < record.t.size:
        rate, t = record[truth_of(record).angular_velocity][lost], record.t[max(lost - 1, 0)]
        why = raised_until(scenario, record.stamps_ns[: lost + 1])
        raise RunError(
            f"diverged: angular velocity {tuple(rate.tolist())} rad/s at {instant(t)} s{why}"
        )
