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

"""The files of a campaign: one Parquet file of runs, one of errors over time."""

import json
from pathlib import Path

from ppc_attitude.campaign.declaration import Campaign
from ppc_attitude.campaign.quantile_bands import EDGES, QUANTITIES, QuantileBands
from ppc_attitude.campaign.rows import Row, row_types
from ppc_attitude.contract.whole_file import naming, unfinished_of, whole_file
from ppc_attitude.science.errors import ConfigurationError, needed_by

RUNS_FILE, FAN_FILE = "runs.parquet", "error_over_time.parquet"
BATCH = 1000
"""Rows that are held before they are written: a row group of the file."""


class Results:
    """The folder of a campaign, written as the runs come; to be closed at the end.

    The files are the same to the last byte for the same runs, however these were computed. They
    appear under their names when they are complete; then the bands are written. What is run is
    in the files' metadata.

    Raises
    ------
    ConfigurationError
        pyarrow is not installed, or the folder exists.
    """

    def __init__(self, folder: Path, campaign: Campaign, bands: QuantileBands) -> None:
        with needed_by("a campaign's results need pyarrow", "campaign"):
            import pyarrow
            import pyarrow.parquet
        if folder.exists():
            raise ConfigurationError(f"folder {folder} exists already and is not overwritten")
        folder.mkdir(parents=True)
        self._arrow, self._parquet = pyarrow, pyarrow.parquet
        self._folder, self._counted = folder, bands
        description = {  # everything that determines the runs
            "seed": campaign.seed,
            "campaign": campaign.declaration,
            "required": campaign.required.to_json(),
            "parameters": campaign.scenario.parameters,
            "versions": campaign.made_with,
        }
        self._metadata = {b"ppc_attitude": json.dumps(description).encode()}
        types = {
            int: pyarrow.int64(),
            float: pyarrow.float64(),
            bool: pyarrow.bool_(),
            str: pyarrow.string(),
        }
        self._schema = pyarrow.schema(
            [(name, types[kind]) for name, kind in row_types(campaign).items()],
            metadata=self._metadata,
        )
        self._rows: list[Row] = []
        self._whole = True  # False after a failed write: the file then has no readable end
        self._unfinished = unfinished_of(folder / RUNS_FILE)
        self._writer = pyarrow.parquet.ParquetWriter(self._unfinished, self._schema)

    def add(self, row: Row) -> None:
        """Keep the row of one run."""
        self._rows.append(row)
        if len(self._rows) == BATCH:
            self._flush()

    def _flush(self) -> None:
        table = self._arrow.Table.from_pylist(self._rows, schema=self._schema)
        self._whole = False
        with naming(self._unfinished):
            self._writer.write_table(table, row_group_size=BATCH)
        self._whole = True
        self._rows.clear()

    def _write_bands(self) -> None:
        quantity, time, level = self._counted.counts[:, :, : EDGES.size + 1].nonzero()
        lower, upper = [0.0, *EDGES.tolist()], [*EDGES.tolist(), float("inf")]
        table = self._arrow.table(
            {
                "quantity": [QUANTITIES[k] for k in quantity],
                "from_s": self._counted.ends[time],
                "to_s": self._counted.ends[time + 1],
                "low": [lower[k] for k in level],
                "high": [upper[k] for k in level],
                "runs": self._counted.counts[quantity, time, level],
            }
        )
        with whole_file(self._folder / FAN_FILE) as file:
            self._parquet.write_table(table.replace_schema_metadata(self._metadata), file)

    def close(self) -> None:
        """Write what is there, also when the campaign was cut short."""
        try:
            if not self._whole:
                return
            if self._rows:
                self._flush()
            with naming(self._unfinished):
                self._writer.close()
            self._unfinished.replace(self._folder / RUNS_FILE)
        finally:
            self._unfinished.unlink(missing_ok=True)  # nobody can read it without its end
        self._write_bands()
