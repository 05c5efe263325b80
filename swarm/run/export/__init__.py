"""A run as tables, for pandas, DuckDB, spreadsheets and the like.

    TickRecord ... --columns.TABLES--> rows --batches--> robots.parquet, frames.parquet, ...

Ticks are read once and rows written by the batch, so memory stays the same however long the run is.
Values are those of the recording, to the bit, in CSV too.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

import msgspec
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from swarm import errors, recording, runs
from swarm import scenario as scenarios
from swarm.run.export.columns import TABLES, Row, Table, markdown
from swarm.scenario import Scenario

Format = Literal["parquet", "csv"]
BATCH_ROWS = 8_192  # of a table in memory, and in a row group; 7 MB of scans with 216 beams
FOLDER = "export"
COLUMNS = "columns.md"


class Exported(msgspec.Struct, frozen=True):
    """What has been written."""

    folder: str
    rows: dict[str, int]  # by table
    first_tick: int
    last_tick: int
    cut: bool  # the recording ends in the middle, or something of it could not be read


def export(path: Path, folder: Path, form: Format) -> Exported:
    """Write all tables of a recording into a folder.

    Raises:
        RecordingError: nothing of it can be read, or it is of another scenario.
        UsageError: the folder cannot be written.
    """
    source = recording.read(path)
    plan = scenarios.decode(source.scenario_toml, f"{path}: {recording.SCENARIO_NAME}")
    about = {**source.metadata, "scenario": source.scenario_toml.decode(errors="replace")}
    ticks: list[int] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with contextlib.ExitStack() as stack:
            sheets = [stack.enter_context(_Sheet(one, folder, form, about)) for one in TABLES]
            for record in source.ticks:
                _check(plan, len(record.robots), record.tick)
                for sheet in sheets:
                    sheet.add(sheet.table.rows(plan, record))
                ticks[1:] = [record.tick]
        problem = runs.write_whole(folder / COLUMNS, markdown().encode())
    except OSError as error:
        problem = f"{error.filename or folder}: {error.strerror or error}"
    if problem is not None:
        raise errors.UsageError(
            f"{problem}; expected a folder that can be written, choose another with --out"
        )
    if not ticks:
        raise errors.RecordingError(f"{path}: expected ticks to export, got none")
    return Exported(
        folder=str(folder),
        rows={sheet.table.name: sheet.count for sheet in sheets},
        first_tick=ticks[0],
        last_tick=ticks[-1],
        cut=source.cut,
    )


def _check(plan: Scenario, robots: int, tick: int) -> None:
    if robots != len(plan.robots):
        raise errors.RecordingError(
            f"tick {tick}: expected the {len(plan.robots)} robots of the scenario, got {robots}"
        )


class _Sheet:
    """One table on its way to a file, which appears under its name only when it is whole."""

    def __init__(self, table: Table, folder: Path, form: Format, about: Mapping[str, str]) -> None:
        self.table = table
        self.count = 0
        self._path = folder / f"{table.name}.{form}"
        self._part = self._path.with_name(f"{self._path.name}.part")
        self._csv = form == "csv"
        self._schema = _schema(table, about, csv=self._csv)
        self._rows: list[Row] = []
        opened: Any = pyarrow.csv.CSVWriter if self._csv else pyarrow.parquet.ParquetWriter
        self._writer = opened(str(self._part), self._schema)

    def __enter__(self) -> _Sheet:
        return self

    def __exit__(self, failure: object, *_: object) -> None:
        try:
            if failure is None:
                self._flush()
            self._writer.close()
            if failure is None:
                self._part.replace(self._path)
        finally:
            self._part.unlink(missing_ok=True)

    def add(self, rows: Iterator[Row]) -> None:
        self._rows += rows
        if len(self._rows) >= BATCH_ROWS:
            self._flush()

    def _flush(self) -> None:
        if not self._rows:
            return
        values = list(zip(*self._rows, strict=True))
        arrays = [
            pa.array(
                [_joined(one) for one in column]
                if pa.types.is_list(spec.type) and self._csv
                else column,
                field.type,
            )
            for column, spec, field in zip(values, self.table.columns, self._schema, strict=True)
        ]
        self._writer.write_table(pa.Table.from_arrays(arrays, schema=self._schema))
        self.count += len(self._rows)
        self._rows = []


def _joined(values: Any) -> str:
    return " ".join(map(str, values.tolist()))


def _schema(table: Table, about: Mapping[str, str], *, csv: bool) -> Any:
    """Names, types, and in their metadata units and meanings."""
    fields = [
        pa.field(
            one.name,
            pa.string() if csv and pa.types.is_list(one.type) else one.type,
            metadata={"unit": one.unit, "description": one.text},
        )
        for one in table.columns
    ]
    return pa.schema(fields, metadata={"table": table.name, "description": table.text, **about})
