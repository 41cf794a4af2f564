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

"""Tables made from runs."""

import csv
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import Ask
from craft_helpers import case
from synthetic import normal_run

from ppc_attitude import bags
from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.export import export, export_csv, export_parquet
from ppc_attitude.bags.reader import read_run
from ppc_attitude.bags.run_writer import write_run
from ppc_attitude.command_line.commands import export as command
from ppc_attitude.contract.declared import BY_COLUMN
from ppc_attitude.contract.run_record import Change, RunRecord
from ppc_attitude.contract.topics import CONTROLLER
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.simulation.closed_loop import simulate


def expected(run: RunRecord) -> dict[str, np.ndarray]:
    # Of 120 s the last instant is at 120 s, and not a last digit beyond it.
    table = {"stamp_ns": run.stamps_ns, "t": run.stamps_ns / 1e9}
    for name in filter(run.columns.__contains__, BY_COLUMN):
        for axis, numbers in zip("xyzw", run[name].T, strict=False):
            table[f"{name}_{axis}"] = numbers
    return table


def test_parquet_has_every_number_and_the_facts(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    run = replace(normal_run(duration=1.0), missing={"torque_command": 1})
    run["torque_command"][7] = np.nan
    export_parquet(run, tmp_path / "run.parquet")
    table = parquet.read_table(tmp_path / "run.parquet")
    columns = expected(run)
    assert table.column_names == list(columns)
    for name, numbers in columns.items():
        np.testing.assert_array_equal(table[name].to_numpy(), numbers, err_msg=name)
    facts = {key.decode(): value.decode() for key, value in table.schema.metadata.items()}
    assert facts["ppc_attitude.controller"] == "ppc"
    assert json.loads(facts["ppc_attitude.parameters"]) == run.parameters
    assert json.loads(facts["ppc_attitude.missing"]) == {"torque_command": 1}


def test_csv_reads_back_to_the_last_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bags.export, "_ROWS", 40)  # instants that are written at a time
    run = normal_run(duration=1.0)
    run["torque_command"][7] = np.nan
    export_csv(run, tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(newline="") as file:
        names, *rows = csv.reader(file)
    columns = expected(run)
    assert names == list(columns)
    assert len(rows) == len(run.stamps_ns) > 2 * 40
    for name, cells in zip(names, zip(*rows, strict=True), strict=True):
        numbers = [float(cell) if cell else np.nan for cell in cells]
        np.testing.assert_array_equal(numbers, columns[name], err_msg=name)
    assert rows[7][names.index("torque_command_x")] == ""


@pytest.mark.parametrize("duration", [0.5, 0.05])  # in the second no fix has an innovation
def test_a_run_and_its_bag_have_one_table_with_every_number(
    duration: float, tmp_path: Path
) -> None:
    run = simulate(case("sensors_smallsat", "wheels"), duration)
    write_run(run, tmp_path / "bag")
    read = read_run(tmp_path / "bag")
    assert read.missing == {}  # not the fixes, which come seldom
    export_csv(run, tmp_path / "run.csv")
    export_csv(read, tmp_path / "bag.csv")
    table = (tmp_path / "run.csv").read_text()
    assert table == (tmp_path / "bag.csv").read_text()
    names = table.partition("\n")[0].split(",")
    assert len(names) == 2 + sum(samples.shape[1] for samples in run.columns.values())
    assert {"estimate_0", "estimate_18", "star_fix_6"} <= set(names)


def test_a_table_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match=r"table\.csv cannot be written: .*File exists"):
        export_csv(normal_run(duration=0.1), tmp_path / "file" / "table.csv")


def test_a_change_in_flight_is_a_column(tmp_path: Path) -> None:
    run = normal_run(duration=0.03)
    changes = (
        Change(10_000_000, CONTROLLER, "k", 4.0),
        Change(20_000_000, CONTROLLER, "k", 5.0),
        Change(20_000_000, CONTROLLER, "tags", ["a", "b"]),
    )
    write_run(replace(run, changes=changes), tmp_path / "bag")
    read = read_run(tmp_path / "bag")
    assert read.changes == changes
    assert [before for _, before in read.told_changes] == [3.0, 4.0, None]
    export(read, tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["ppc_controller.k"] for row in rows] == ["3.0", "4.0", "5.0", "5.0"]
    assert [row["ppc_controller.tags"] for row in rows] == ["", "", '["a", "b"]', '["a", "b"]']
    parquet = pytest.importorskip("pyarrow.parquet")
    export(read, tmp_path / "run.parquet")
    table = parquet.read_table(tmp_path / "run.parquet")
    assert table["ppc_controller.k"].to_pylist() == [3.0, 4.0, 5.0, 5.0]


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (1, 2.5, [1.0, 2.5]),
        (1, "fast", ["1", '"fast"']),
        (True, 3, ["true", "3"]),
        (2**70, 1, [str(2**70), "1"]),
    ],
)
def test_a_parameter_that_changes_its_type_is_told_too(
    old: object, new: object, told: list[object], tmp_path: Path
) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    changes = (Change(10_000_000, CONTROLLER, "k", new),)
    run = replace(normal_run(duration=0.01), parameters={CONTROLLER: {"k": old}}, changes=changes)
    export(run, tmp_path / "run.parquet")
    table = parquet.read_table(tmp_path / "run.parquet")
    assert table["ppc_controller.k"].to_pylist() == told


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_changes_take_no_more_room_than_is_allowed(
    form: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bags.export, "_SMALL", 2**20)
    if form == "parquet":
        pytest.importorskip("pyarrow")
    run = normal_run(duration=20.0)
    stamp, last = int(run.stamps_ns[5]), int(run.stamps_ns[-1])
    few = [Change(stamp, CONTROLLER, "k1", 2.0), Change(last, CONTROLLER, "k1", 3.0)]
    many = [Change(stamp, "stranger", f"p{count}", 1.0) for count in range(20_000)]
    long = [Change(stamp, "stranger", "text", "x" * 2**20)]
    written = export(replace(run, changes=(*few, *long, *many)), tmp_path / f"run.{form}")
    assert "changed in flight are left out" in written
    assert "stranger.text, stranger.p" in written
    assert (tmp_path / f"run.{form}").stat().st_size < 10 * 2**20
    assert export(replace(run, changes=tuple(few)), tmp_path / f"few.{form}") == ""


def test_the_command_warns_of_what_the_table_lacks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ask: Ask
) -> None:
    write_run(normal_run(duration=0.1), tmp_path / "bag")
    monkeypatch.setattr(command, "export_csv", lambda *_: "much is left out")
    told = ask("export", tmp_path / "bag", "--csv", tmp_path / "run.csv")
    assert told.err == "warning: much is left out\n"


def test_missing_pyarrow_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ConfigurationError, match=r"Parquet needs pyarrow: pip install .*campaign"):
        export_parquet(normal_run(duration=0.1), tmp_path / "out")
