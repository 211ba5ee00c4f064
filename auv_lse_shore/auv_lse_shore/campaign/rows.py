"""Result rows of a campaign: one Parquet file per mission, written when it ends and never changed.

A row file is written under another name and then renamed, so it is never incomplete. A campaign that is killed loses
only the missions that were running. `results.parquet` holds all rows in one table.
"""

import dataclasses
import json
import math
import os
import types
import typing
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.support.missing_packages import missing
from auv_lse_shore.campaign.spec import CampaignSpec, Job
from auv_lse_shore.campaign.statistics import Interval, interval
from auv_lse_shore.judge.summary import Summary

try:
    import pyarrow
    import pyarrow.parquet
except ImportError as error:
    raise missing(error, "campaigns") from error

#: The first columns of a row: its mission, and whether it succeeded.
HEADER = (
    ("id", pyarrow.string()),
    ("group", pyarrow.string()),
    ("status", pyarrow.string()),
    ("error", pyarrow.string()),
    ("traceback", pyarrow.string()),
    ("worker", pyarrow.string()),
    ("finished_utc", pyarrow.string()),
    ("busy_s", pyarrow.float64()),
    ("version", pyarrow.string()),
    ("parameters", pyarrow.string()),
)

#: Columns that hold a curve over steps.
CURVES = ("stepwise", "bound", "whole", "whole_bound", "risk", "expected_risk")


def schema(varied: Mapping[str, Sequence[Any]]) -> pyarrow.Schema:
    """Columns of a campaign: header, varied parameters (named as in the mission file), summary, curves."""
    columns = list(HEADER)
    columns += [(name, _type_of(values)) for name, values in varied.items()]
    hints = typing.get_type_hints(Summary)
    columns += [(field.name, _summary_type(hints[field.name])) for field in dataclasses.fields(Summary)]
    columns += [(name, pyarrow.list_(pyarrow.float32())) for name in CURVES]
    return pyarrow.schema(columns)


def columns_of(spec: CampaignSpec) -> Any:
    """Columns of a campaign's rows."""
    return schema({name: [_cell(v[name]) for _, v in spec.settings if name in v] for name in spec.varied})


def names_of(job: Job) -> dict[str, Any]:
    """The columns that identify a mission in its campaign; they change with the campaign file."""
    varied = {name: _cell(value) for name, value in job.varied.items()}
    return {"id": job.id, "group": job.group, "seed": job.seed, **varied}


def rows_of(spec: CampaignSpec, rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The rows of a campaign's missions, in its order, with the names of its current file."""
    by_id = {row["id"]: row for row in rows}
    return [{**by_id[job.id], **names_of(job)} for job in spec.jobs() if job.id in by_id]


def _type_of(values: Sequence[Any]) -> pyarrow.DataType:
    kinds = {type(v) for v in values}
    if kinds <= {bool}:
        return pyarrow.bool_()
    if kinds <= {int}:
        return pyarrow.int64()
    if kinds <= {int, float}:
        return pyarrow.float64()
    return pyarrow.string()


def _summary_type(hint: Any) -> pyarrow.DataType:
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        hint = next(a for a in typing.get_args(hint) if a is not type(None))
    if typing.get_origin(hint) is tuple:
        return pyarrow.list_(pyarrow.float64())
    return {int: pyarrow.int64(), float: pyarrow.float64(), bool: pyarrow.bool_(), str: pyarrow.string()}[hint]


Row = Mapping[str, Any]


class Rows:
    """The rows of one campaign's folder."""

    def __init__(self, folder: Path, columns: pyarrow.Schema) -> None:
        """Opens the folder; the first row makes it if it is missing."""
        self.folder = folder / "rows"
        self.table_file = folder / "results.parquet"
        self._columns = columns

    def write(self, row: Mapping[str, Any]) -> Path:
        """Writes one row; missing columns are null."""
        self.folder.mkdir(parents=True, exist_ok=True)
        path = self.folder / f"{row['id']}.parquet"
        self._write([row], path)
        return path

    def statuses(self) -> dict[str, str]:
        """Status ("ok", "failed") of every row by id; a damaged file is renamed."""
        return {row["id"]: row["status"] for row in self._tables(["id", "status"])}

    def read(self) -> list[dict[str, Any]]:
        """Every row as a mapping; a damaged file is renamed."""
        return list(self._tables(None))

    def _tables(self, columns: list[str] | None) -> Iterator[dict[str, Any]]:
        for path in sorted(self.folder.glob("*.parquet")):
            try:
                rows = pyarrow.parquet.read_table(path, columns=columns).to_pylist()
            except (pyarrow.ArrowException, OSError):
                rows = []
            if len(rows) == 1:
                yield rows[0]
            else:
                path.rename(path.with_suffix(".broken"))

    def write_table(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """Writes `results.parquet` with these rows; without rows removes it."""
        if not rows:
            self.table_file.unlink(missing_ok=True)
            return
        self._write(rows, self.table_file)

    def _write(self, rows: Sequence[Mapping[str, Any]], path: Path) -> None:
        columns = {
            name: [_fit(row.get(name), kind) for row in rows]
            for name, kind in zip(self._columns.names, self._columns.types, strict=True)
        }
        part = path.with_suffix(f".{os.getpid()}.part")
        try:
            pyarrow.parquet.write_table(pyarrow.table(columns, schema=self._columns), part)
            os.replace(part, path)
        except OSError as error:
            part.unlink(missing_ok=True)
            raise OSError(f"{path}: {os.strerror(error.errno) if error.errno else error}") from error


def _fit(value: Any, kind: pyarrow.DataType) -> Any:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return None
    if pyarrow.types.is_string(kind):
        return str(value)
    if pyarrow.types.is_list(kind):
        return [float(v) for v in value]
    return value


def _cell(value: Any) -> Any:
    return value if isinstance(value, bool | int | float | str) else json.dumps(value)


def value_of(row: Row, column: str) -> float | None:
    """A row's value in a column: the mean where it has one value per vehicle, None if unknown."""
    value = row.get(column)
    if isinstance(value, list):
        known = [v for v in value if v is not None]
        return float(np.mean(known)) if known else None
    return None if value is None else float(value)


def known_values(rows: Sequence[Row], column: str) -> list[float]:
    """The finite values of rows in a column."""
    return [v for v in (value_of(r, column) for r in rows) if v is not None and math.isfinite(v)]


def mean_of(rows: Sequence[Row], column: str) -> Interval:
    """Mean of a column over rows, with its confidence interval."""
    return interval([value_of(r, column) for r in rows])


def by_seed(rows: Sequence[Row], column: str) -> dict[int, float | None]:
    """A column's values by seed."""
    return {int(row["seed"]): value_of(row, column) for row in rows}


def by_group(spec: CampaignSpec, rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Finished rows by setting, in the campaign's order; settings without rows are left out."""
    groups = {label: [r for r in rows if r["group"] == label and r["status"] == "ok"] for label, _ in spec.settings}
    return {label: found for label, found in groups.items() if found}
