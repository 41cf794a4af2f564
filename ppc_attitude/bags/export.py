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

"""A run as one wide table, for pandas and spreadsheets.

Columns: ``stamp_ns``, ``t`` [s], then every number of every sample: ``attitude_x``, …,
``torque_command_z``; the numbers of a column with more than four are counted: ``estimate_0``.
Missing samples are NaN in Parquet and empty in CSV. A parameter that was changed in flight has a
column ``node.name`` with its value at each instant, unless such columns would take much more room
than the samples: a message of a stranger's bag may name thousands of parameters, or a long text.
"""

import contextlib
import csv
import json
import os
from collections.abc import Iterator
from io import TextIOWrapper
from itertools import pairwise
from math import isnan
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ppc_attitude.bags.custom_data import encode_custom_data
from ppc_attitude.bags.errors import BagError
from ppc_attitude.contract.declared import BY_COLUMN
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.whole_file import whole_file
from ppc_attitude.science.errors import needed_by

_AXES = "xyzw"
_ROWS = 10_000
# Room of the columns of changed parameters: `_SMALL`, and `_TIMES` the room of the samples.
_SMALL, _TIMES = 64 * 2**20, 8  # [B]
_CELL = 8  # bytes beside a text
_NAMED = 3  # of those left out


def export(record: RunRecord, target: Path) -> str:
    """Write a run as Parquet or CSV, by the file's suffix; see `export_parquet`, `export_csv`."""
    return (export_parquet if target.suffix == ".parquet" else export_csv)(record, target)


def export_parquet(record: RunRecord, target: Path) -> str:
    """Write a run as a Parquet file, which must not exist yet; say what it lacks, if anything.

    The file's metadata carry controller, parameters, run metadata, missing counts and warnings.

    Raises
    ------
    BagError
        The file exists or cannot be written.
    ConfigurationError
        pyarrow is not installed.
    """
    with needed_by("Parquet needs pyarrow", "campaign"):
        import pyarrow
        import pyarrow.parquet
    facts = {
        **encode_custom_data(record.controller, record.parameters, record.metadata),
        "ppc_attitude.missing": json.dumps(dict(record.missing)),
        "ppc_attitude.warnings": json.dumps(record.warnings, ensure_ascii=False),
    }
    columns, lacking = _table(record)
    table = pyarrow.table(columns).replace_schema_metadata(facts)
    with _new_file(target) as file:
        pyarrow.parquet.write_table(table, file)
    return lacking


def export_csv(record: RunRecord, target: Path) -> str:
    """Write a run as CSV; every number reads back to the last bit. Else as `export_parquet`."""
    columns, lacking = _table(record)
    with _new_file(target) as binary, TextIOWrapper(binary, "utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        for start in range(0, len(record.stamps_ns), _ROWS):
            cells = (_cells(column[start : start + _ROWS]) for column in columns.values())
            writer.writerows(zip(*cells, strict=True))
    return lacking


@contextlib.contextmanager
def _new_file(target: Path) -> Iterator[BinaryIO]:
    if os.path.lexists(target):
        raise BagError(f"{target} exists already and is not overwritten; choose another file")
    try:
        with whole_file(target) as file:
            yield file
    except OSError as error:
        raise BagError(f"{target} cannot be written: {error.strerror or error}") from error


def _table(record: RunRecord) -> tuple[dict[str, Any], str]:
    """Every column of the table by its name, and what is left out."""
    table: dict[str, Any] = {"stamp_ns": record.stamps_ns, "t": record.t}
    order = {name: place for place, name in enumerate(BY_COLUMN)}
    for name in sorted(record.columns, key=lambda each: order.get(each, len(order))):
        numbers = record[name].T
        of_parts = name in BY_COLUMN and BY_COLUMN[name].part
        axes = map(str, range(len(numbers))) if of_parts or len(numbers) > len(_AXES) else _AXES
        for axis, samples in zip(axes, numbers, strict=False):
            table[f"{name}_{axis}"] = samples
    changed, lacking = _changed(record)
    return {**table, **changed}, lacking


def _changed(record: RunRecord) -> tuple[dict[str, list[Any]], str]:
    """Values, at each instant, of the parameters that were changed in flight, and what is left out.

    Without the columns that would take more room than is allowed.
    """
    size = len(record.stamps_ns)
    steps: dict[str, list[tuple[int, Any]]] = {}
    for change, before in record.told_changes:
        start = int(np.searchsorted(record.stamps_ns, change.stamp_ns))
        told = steps.setdefault(f"{change.node}.{change.name}", [(0, before)])
        told.append((start, change.value))
    room = _SMALL + _TIMES * sum(samples.nbytes for samples in record.columns.values())
    columns: dict[str, list[Any]] = {}
    lacking = []
    for name, told in steps.items():
        if not all(_is_number(value) for _, value in told):
            told = [(k, x if x is None else json.dumps(x, ensure_ascii=False)) for k, x in told]
        texts = [len(value) for _, value in told if isinstance(value, str)]
        needed = size * (_CELL + max(texts, default=0))
        if needed > room:
            lacking.append(name)
            continue
        room -= needed
        column: list[Any] = []
        for (start, value), (end, _) in pairwise([*told, (size, None)]):
            column += [value] * (end - start)
        columns[name] = column
    if not lacking:
        return columns, ""
    more = ", …" if len(lacking) > _NAMED else ""
    return columns, (
        f"{len(lacking)} parameters that were changed in flight are left out of the table, which "
        f"they would make too large: {', '.join(lacking[:_NAMED])}{more}"
    )


def _is_number(value: Any) -> bool:
    """Whether a value fits into a column of numbers, with None where nothing is known."""
    if isinstance(value, int) and not isinstance(value, bool):
        return abs(value) < 2**63
    return value is None or isinstance(value, float)


def _cells(column: Any) -> list[Any]:
    """Cells of a column as they are written; None, an empty cell, for NaN."""
    if isinstance(column, list):
        return column
    return [None if isnan(number) else number for number in column.tolist()]
