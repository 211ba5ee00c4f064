"""Tables of soundings: any delimiter, header, unit and encoding; Deeper, ReefMaster, PINGMapper, SonarTRX, our own."""

import dataclasses

import numpy as np

from auv_lse_common.support.plurals import counted, listed
from auv_lse_common.support.text import is_text
from auv_lse_gp.tables.column_names import Column
from auv_lse_gp.tables.dialect import Dialect, columns_of, dialect_of
from auv_lse_gp.tables.table_error import TableError
from auv_lse_gp.tables.values import SAMPLE_LETTERS, read_values
from auv_lse_shore.survey_import.log_content import Clock, LogContent, Sounder
from auv_lse_shore.survey_import.log_file import LogFile, ReadOptions
from auv_lse_shore.survey_import.parsing import table_values as tv
from auv_lse_shore.survey_import.parsing.columns import (
    Table,
    columns_for,
    other_header,
    unused_columns,
    vehicles_of,
    with_all_names,
)
from auv_lse_shore.survey_import.parsing.vertical_reference import reduced_to
from auv_lse_shore.survey_import.survey_log import LogError

#: The most columns that are listed as not used.
_MOST_LISTED = 12
#: Any text may be a table.
ASKED_LAST = True


def recognizes(file: LogFile) -> bool:
    """Whether it is text with columns."""
    if not is_text(file.head):
        return False
    return dialect_of(tv.beginning(file.head)) is not None


def read(file: LogFile, options: ReadOptions) -> list[LogContent]:
    """Reads a table: one log of each vehicle in it.

    Raises:
        LogError: if its columns are not known, with a proposal.
        OSError: if it cannot be read.
    """
    text = file.text.replace("\u2212", "-")  # a typographic minus
    dialect = dialect_of(text[:SAMPLE_LETTERS])
    if dialect is None:
        raise LogError(f"{file.path} has no columns of numbers.")
    options.used.add("columns")
    dialect = dialect if options.columns else with_all_names(dialect)
    columns = columns_for(file.path, dialect, options.columns, text)
    if not options.columns and (other := other_header(text, dialect, columns))[0]:
        raise LogError(
            f"{file.path} has two headers, {','.join(dialect.header)} and {other[1]} in line {other[0]}. Split it there"
        )
    try:
        return _contents(file, text, dialect, columns, options)
    except TableError as error:
        raise LogError(str(error)) from error


def _contents(
    file: LogFile, text: str, dialect: Dialect, columns: dict[str, Column], options: ReadOptions
) -> list[LogContent]:
    """The logs of the vehicles in a table."""
    is_given = bool(options.depth_unit_m) or "depth_unit" in columns
    joined = list[int]()
    values = read_values(file.path, text, dialect, columns, is_given, file.progress, joined=joined)
    table = Table(path=file.path, columns=columns, values=values, decimal_comma=dialect.decimal_comma)
    if not table.count:
        raise LogError(f"{file.path} has a header and no rows of values.")
    shared = LogContent(file.path.name)
    shared.left_out.update(dict(tv.lines_left_out(text, sum(joined))))
    shared.notes += tv.unreadable(table, lambda number: next(columns_of(text, dialect, [number]))[0])
    rows = tv.rows_of(table, options, shared)
    shared.notes += [reduced_to(name) for name in np.unique(table.values.get("vertical_datum", [])).tolist() if name]
    if not options.columns and (unused := unused_columns(dialect.header, columns, table.accounted)):
        shared.notes.append(f"columns not used: {listed([name[:40] for name in unused], _MOST_LISTED)}")
    contents = []
    for name, mask in vehicles_of(table):
        own = rows.of(mask)
        stood = np.zeros(len(own.time_s), dtype=bool)
        if shared.clock is not Clock.NONE:
            times, stood = tv.spread_times(own.time_s, own.positions, own.is_geodetic)
            own = dataclasses.replace(own, time_s=times)
        for part, words in (
            (~stood, name),
            (stood, f"{name}, {counted(int(stood.sum()), 'row')} while the clock stood still"),
        ):
            if part.any():
                content = LogContent(f"{file.path.name}{words}", shared.clock)
                content.stood_still = bool(stood[part].any())
                content.is_checked, content.notes = "order" in columns, [*shared.notes]
                content.questions = [*shared.questions]
                content.lag_std_s = shared.lag_std_s
                _fill(content, own.of(part))
                contents.append(content)
    contents[0].left_out.update(shared.left_out)
    return contents


def _fill(content: LogContent, rows: tv.Rows) -> None:
    """Adds the positions and depths of one vehicle."""
    content.is_geodetic, content.depth_std_m = rows.is_geodetic, rows.depth_std_m
    known = np.isfinite(rows.own_depth_m)
    content.own_depths = np.column_stack([rows.time_s, rows.own_depth_m])[known]
    content.add_positions("its columns", np.column_stack([rows.time_s, rows.positions])[rows.is_position])
    if rows.position_std_m is not None:
        order = np.argsort(rows.time_s[rows.is_position], kind="stable")
        content.position_std_m = rows.position_std_m[rows.is_position][order]
    for name in np.unique(rows.sounders):
        mask = (rows.sounders == name) & np.isfinite(rows.depth_m)
        content.sounders[str(name)] = Sounder(reference=rows.reference, quality_scale=rows.quality_scale)
        content.add_depths(str(name), np.column_stack([rows.time_s, rows.depth_m, rows.quality])[mask])
