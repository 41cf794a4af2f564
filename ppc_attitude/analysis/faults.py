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

"""The faults of a run: which of the plant's hardware failed, from when to when."""

from contextlib import suppress
from itertools import pairwise
from typing import NamedTuple

from ppc_attitude.analysis.series import once, zero_ns
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.faults import FAULTS, MOST_FAULTS, acting_of, fault_of, fault_texts
from ppc_attitude.science.stamps import instant, seconds


class Acting(NamedTuple):
    """A fault as it acted: what failed and how, from when to when in the time of the run."""

    text: str
    start_s: float
    end_s: float

    def __str__(self) -> str:
        """Tell it in a few words."""
        return f"{self.text}, {instant(self.start_s)} to {instant(self.end_s)} s"


@once
def faults_of(record: RunRecord) -> tuple[Acting, ...]:
    """Faults that acted, by their start; spans of one that touch are one."""
    changes = (each for each in record.changes if each[1:3] == (PLANT, FAULTS.name))
    found: dict[str, list[tuple[int, int]]] = {}
    for part, told in record.stretches(changes):
        known = fault_texts(told.get(PLANT, {}))[:MOST_FAULTS]  # a plant takes no more
        since, until = record.stamps_ns.take([part.start, part.stop], mode="clip").tolist()
        times = {since, until}
        for text in known:
            with suppress(ConfigurationError):
                fault = fault_of(text)
                times |= {t for t in (fault.start_ns, fault.end_ns) if since < t < until}
        for begin, end in pairwise(sorted(times)):
            for what in acting_of(known, begin):
                spans = found.setdefault(what, [])
                touches = spans and spans[-1][1] == begin
                spans.append((spans.pop()[0] if touches else begin, end))
    zero = zero_ns(record)
    every = [
        Acting(what, seconds(begin - zero), seconds(end - zero))
        for what, spans in found.items()
        for begin, end in spans
    ]
    return tuple(sorted(every, key=lambda each: each.start_s))
