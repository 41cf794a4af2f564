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

"""Compare a bag of a run with parts from outside with the loop in process."""

from contextlib import redirect_stdout
from io import StringIO
from unittest import mock

from matplotlib.figure import Figure

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line.main import main
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import load


def compare(bag: str, *configs: str) -> int:
    """Print the columns of the record, and how its replay differs."""
    recorded, computed = read_run(bag), simulate(load(configs), 1.3)
    assert not recorded.missing, recorded.missing
    assert not recorded.warnings, recorded.warnings
    columns = set(computed.columns)
    assert set(recorded.columns) == columns, set(recorded.columns) ^ columns
    for name, column in computed.columns.items():
        assert recorded[name].tobytes() == column.tobytes(), name
    print(*computed.columns)
    hits = Verdict(recorded).to_json()["metrics"]["disturbances"]
    assert [each["torque"] for each in hits] == [(0.0, 0.03, 0.0)], hits
    told = StringIO()
    with redirect_stdout(told):
        assert main(["check", *(f"--config={each}" for each in configs)]) == 0
        assert "torque authority  0.05 > 0.012 N" in told.getvalue(), told.getvalue()
        assert "room  0.05 ≤ 0.05 N·m  holds" in told.getvalue(), told.getvalue()
        with mock.patch.object(Figure, "savefig"):  # that it draws is another test's
            main(["analyse", bag, "--report", "report.html"])
    return main(["replay", bag, "--json"])
