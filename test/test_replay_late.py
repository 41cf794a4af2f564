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

"""Replay of what comes late: a message that is missing, or that is of no instant on record."""

from dataclasses import replace

import numpy as np
from synthetic import with_columns
from test_replay import differing, estimated

from ppc_attitude.contract.run_record import Change
from ppc_attitude.contract.topics import ENABLED, ESTIMATOR
from ppc_attitude.science.estimators import mekf
from ppc_attitude.science.kinds import ESTIMATORS
from ppc_attitude.science.sensors.star_tracker import Slots
from ppc_attitude.simulation.closed_loop import by_column, simulate
from ppc_attitude.simulation.replay import _computed, _read, replay


def test_a_late_message_that_no_component_gave_differs() -> None:
    """One that is not on record may have been lost."""
    record = simulate(estimated(), 2.0)
    came = np.flatnonzero(np.isfinite(record["innovation"][:, 0]))
    innovations = record["innovation"].copy()
    innovations[came[3:]] = np.nan
    assert not differing(with_columns(record, innovation=innovations))
    innovations[came[1] + 1] = 0.7
    (differs,) = (
        each
        for each in replay(with_columns(record, innovation=innovations)).found
        if each.largest > 0.0
    )
    assert (differs.component, differs.column, differs.largest) == ("mekf", "innovation", np.inf)


def test_a_late_message_from_after_the_end_of_the_record_is_no_difference() -> None:
    """Its recorder ended while the stack ran on: the fix came before the state of its instant."""
    record = simulate(estimated(), 2.0)
    last = int(np.flatnonzero(np.isfinite(record["star_fix"][:, 0]))[-1])
    cut = replace(
        record,
        stamps_ns=record.stamps_ns[: last + 1],
        columns={name: rows[: last + 1] for name, rows in record.columns.items()},
    )
    assert not differing(cut)
    fixes = cut["star_fix"].copy()
    fixes[last // 2 + 1] = fixes[last]
    assert differing(with_columns(cut, star_fix=fixes)) == {"gyro_star_tracker"}


def test_an_innovation_of_a_filter_that_was_killed_amid_its_answer_is_no_difference() -> None:
    """Its successor answered the same instant, and begins with a fix, without an innovation."""
    record = simulate(estimated(), 2.0)
    came = np.flatnonzero(np.isfinite(record["innovation"][:, 0]))
    slots = Slots(record.parameters[ESTIMATOR])
    valid = int(came[len(came) // 2])
    stamps = record.stamps_ns.tolist()
    place = next(k for k, stamp in enumerate(stamps) if slots.arrived(stamps[valid], stamp))
    begun = Change(stamps[place], ESTIMATOR, ENABLED, True)
    record = replace(record, changes=(begun,))
    given = mekf.COMPONENT.outputs
    read = _read(record, mekf.COMPONENT, record.parameters[ESTIMATOR])
    rows = _computed(record, ESTIMATORS, mekf.COMPONENT, record.stamps_ns, read, given)
    record = with_columns(record, **by_column(given, record.stamps_ns, rows))
    assert "mekf" not in differing(record)
    for when, differs in ((valid, False), (valid - 1, True), (place + 1, True)):
        innovations = record["innovation"].copy()
        assert np.isnan(innovations[when]).all()
        innovations[when] = 0.7
        assert ("mekf" in differing(with_columns(record, innovation=innovations))) == differs
