"""The values of a table: positions, depths in metres, and times, from columns whose meaning is known."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.support.arrays import Array, Mask
from auv_lse_common.support.text import text_of
from auv_lse_common.vocabulary.frames import FAR_M
from auv_lse_common.vocabulary.sounding import DEEPEST_M
from auv_lse_gp.tables.angles import degrees_of
from auv_lse_gp.tables.column_names import DEPTHS, Column
from auv_lse_gp.tables.dialect import LONGEST, long_lines, open_quote
from auv_lse_gp.tables.units import factor_of, is_unstated, stated_m, stated_units, unit_column
from auv_lse_shore.export.uncertainty import SIGMAS_95
from auv_lse_shore.survey_import.log_content import NO_POSITION, NOT_ON_EARTH, Clock, LogContent, Reference
from auv_lse_shore.survey_import.log_file import ReadOptions
from auv_lse_shore.survey_import.parsing.columns import Table, depth_role, first_of
from auv_lse_shore.survey_import.parsing.stated_crs import stated_crs
from auv_lse_shore.survey_import.parsing.table_times import times_of
from auv_lse_shore.survey_import.survey_log import JUMP_M, MAX_SPEED_MPS, LogError

#: Values that commonly mark missing data, with either sign.
_NO_DATA = (9999.0, 99999.0, 32767.0, 32768.0, 999.0, 999.9, 999.99, 65535.0, 655.35)
#: A column of sounders with more names than this numbers something else.
_MOST_SOUNDERS = 50
#: Units that differ by less than this share are the same.
_SAME_UNIT = 1e-5
#: Metres of a degree.
_DEGREE_M = 111_000.0
#: Largest distance (deg) between the quartiles of columns x, y in degrees: more than 100 km.
_WIDE_DEG = 2.0
#: An altitude that stays below this (m) may be above the bottom.
_LOW_M = 100.0
#: Share of the depths' changes that remains in their difference from heights that follow them.
_FOLLOWS = 0.2
#: Names by which depths are measured from the transducer or the keel.
_BELOW = {
    "transducer": Reference.TRANSDUCER,
    "dbt": Reference.TRANSDUCER,
    "keel": Reference.KEEL,
    "dbk": Reference.KEEL,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Rows:
    """The values of a table's rows, shape (n,) each; `positions` (n, 2); `own_depth_m`: the vehicle's, 0 for a boat."""

    time_s: Array
    positions: Array
    is_position: Mask
    depth_m: Array
    own_depth_m: Array
    quality: Array
    sounders: NDArray[np.str_]
    is_geodetic: bool
    reference: Reference
    quality_scale: float
    depth_std_m: float
    position_std_m: Array | None

    def of(self, mask: Mask) -> Rows:
        """The rows of a mask."""
        if mask.all():
            return self
        return dataclasses.replace(
            self,
            time_s=self.time_s[mask],
            positions=self.positions[mask],
            is_position=self.is_position[mask],
            depth_m=self.depth_m[mask],
            own_depth_m=self.own_depth_m[mask],
            quality=self.quality[mask],
            sounders=self.sounders[mask],
            position_std_m=None if self.position_std_m is None else self.position_std_m[mask],
        )


def beginning(head: bytes) -> str:
    """The text of a file's beginning, without the line that is cut off."""
    text = text_of(head)
    return text[: text.rfind("\n") + 1] or text


def lines_left_out(text: str, joined: int) -> Iterator[tuple[str, int]]:
    """The number of lines that are not rows of a table, by reason; `joined` of them are inside quoted cells."""
    if long := long_lines(text):
        yield f"lines of more than {LONGEST:,} letters (the first is line {long[0]})", len(long)
    if joined:
        yield f"lines inside a quoted cell (a quote is open in line {open_quote(text)})", joined


def unreadable(table: Table, cells_of: Callable[[int], Sequence[str]]) -> list[str]:
    """A remark about a column of qualities in which no cell is a number.

    Args:
        cells_of: The first cells of a column as texts, by its number.

    Raises:
        LogError: for such a column of depths or angles, if it begins with digits; shows a cell.
    """
    depth = depth_role(table.columns)
    for role in (depth, "lat", "lon", "north", "east", "x", "y"):
        column = table.columns.get(role)
        if column is None or not np.isnan(table.values[role]).all():
            continue
        written = [cell.strip() for cell in cells_of(column.number) if cell.strip()]
        if role == depth and written and all(re.match(r"[+-]?[.,]?\d.*[^\d.,]", cell) for cell in written):
            raise LogError(
                f"{table.path}: its depths are not numbers, such as {written[0]!r}. Leave only the numbers in the "
                "cells, and put their unit into the header, such as depth_ft, or into --depth-unit."
            )
        if role != depth and (wrong := next((cell for cell in written if re.search(r"\d", cell)), "")):
            example = (
                "degrees, such as -46.5083, or 46 30.5 S" if role in ("lat", "lon") else "metres, such as 5150199.34"
            )
            raise LogError(
                f"{table.path}: its positions are neither numbers nor angles, such as {wrong[:40]!r}. Write {example}."
            )
    quality = table.columns.get("quality")
    if (
        quality is None
        or not np.isnan(table.values["quality"]).all()
        or not (word := first_of(cells_of(quality.number)))
    ):
        return []
    return [f"column {quality.name} is ignored: {word!r} is not a number"]


def _in_units_of(table: Table, names: Sequence[str], positions: Array, unit_m: float) -> Array:
    """Converts positions (n, 2) from the columns' own units to `unit_m`; a column without a unit is in it already."""
    factors = [factor_of(table.columns[name].unit) / unit_m or 1.0 for name in names]
    # survey feet are often just called feet
    return positions * [1.0 if abs(factor - 1.0) < _SAME_UNIT else factor for factor in factors]


def rows_of(table: Table, options: ReadOptions, content: LogContent) -> Rows:
    """The rows of a table; what is left out, the clock and remarks go into `content`.

    Raises:
        LogError: if elevations lack the water surface, or metres their coordinate system.
    """
    positions, is_geodetic = _positions(table, options, content)
    missing = ~np.isfinite(positions).all(axis=1)
    zero = (positions == 0.0).all(axis=1) & is_geodetic
    wrong = is_geodetic & ((np.abs(positions[:, 0]) > 90.0) | (np.abs(positions[:, 1]) > 360.0))
    content.left_out["positions that are not numeric"] += int(missing.sum())
    content.left_out[NO_POSITION] += int(zero.sum())
    content.left_out[NOT_ON_EARTH] += int(wrong.sum())
    time_s = times_of(table, _steps_m(positions, is_geodetic), options, content)
    timeless = ~np.isfinite(time_s)
    content.left_out["rows without a time"] += int(timeless.sum())
    depth_m, own_depth_m, reference = _depths(table, options, content)
    # a position that is repeated while the boat moves is an old one: see `track.py`
    is_position = ~(missing | zero | wrong | timeless)
    if content.clock is Clock.NONE:  # no time to interpolate by
        depth_m = np.where(is_position, depth_m, np.nan)
    quality = table.values.get("quality", np.full(table.count, np.nan))
    tvu = table.values.get("tvu")
    sounders = table.values.get("sounder", np.full(table.count, "depth"))
    column = table.columns.get("sounder")
    if column is not None:
        few = len(np.unique(sounders)) <= _MOST_SOUNDERS
        sounders = np.char.strip(np.char.add(f"{column.name} ", sounders)) if few else np.full(table.count, "depth")
    depth_std_m = 0.0 if tvu is None else float(np.nan_to_num(tvu).max(initial=0.0)) / SIGMAS_95
    if _stated_std(table) is not None:
        content.notes.append("positions as estimated before, with their standard deviations (north_std_m, east_std_m)")
    if depth_std_m:
        content.notes.append(f"depths with a standard deviation of at most {depth_std_m:.2f} m (tvu_m)")
    unit = table.columns["quality"].unit if "quality" in table.columns else ""
    return Rows(
        time_s=np.where(timeless, 0.0, time_s),
        positions=positions,
        is_position=is_position,
        depth_m=np.where(timeless | wrong, np.nan, depth_m),
        own_depth_m=np.where(timeless, np.nan, own_depth_m),
        quality=quality,
        sounders=sounders,
        is_geodetic=is_geodetic,
        reference=reference,
        quality_scale=100.0 if unit in ("%", "percent") else 0.0,
        depth_std_m=depth_std_m,
        position_std_m=_stated_std(table),
    )


def _stated_std(table: Table) -> Array | None:
    """Standard deviations north and east (m), shape (n, 2), if the table has them."""
    if not {"north_std", "east_std"} <= table.values.keys():
        return None
    stds: Array = np.abs(np.column_stack([table.values["north_std"], table.values["east_std"]]))
    return stds


def spread_times(time_s: Array, positions: Array, is_geodetic: bool) -> tuple[Array, Mask]:
    """Times (n,) of rows in order, and which rows have none because the clock stood still.

    A coarse clock gives several rows at different positions the same time: they are spread over the time to the next.
    If the boat would have been too fast for that, the clock stood still: these rows keep their order, 1 ms apart.
    """
    starts = np.flatnonzero(np.append(True, np.diff(time_s) != 0.0))
    counts = np.diff(np.append(starts, len(time_s)))
    way_m = np.append(_steps_m(positions, is_geodetic), 0.0)  # to the next row
    way_m[np.append(starts[1:], len(time_s)) - 1] = 0.0
    inner_m = np.add.reduceat(np.nan_to_num(way_m, posinf=0.0).clip(max=1e9), starts)
    if not inner_m.any():
        return time_s, np.zeros(len(time_s), dtype=bool)
    steps = np.append(np.diff(time_s[starts]), np.inf)
    known = steps[(steps > 0.0) & np.isfinite(steps)]
    usual = float(np.median(known)) if len(known) else 1.0
    spans = np.where((steps > 0.0) & (steps < 3.0 * usual), steps, usual)
    stood = (counts > 2) & (inner_m > MAX_SPEED_MPS * spans + JUMP_M)
    spans = np.where(stood, 1e-3 * counts, spans)
    order = np.arange(len(time_s)) - np.repeat(starts, counts)
    return time_s + np.repeat(spans / counts, counts) * order, np.repeat(stood, counts)


def _steps_m(positions: Array, is_geodetic: bool) -> Array:
    """Distances (m) between rows that follow each other, roughly, (n - 1)."""
    with np.errstate(over="ignore", invalid="ignore"):
        steps: Array = np.hypot(*np.diff(positions, axis=0).T) * (_DEGREE_M if is_geodetic else 1.0)
    return steps


def _positions(table: Table, options: ReadOptions, content: LogContent) -> tuple[Array, bool]:
    """Latitude and longitude, or metres north and east; and whether they are degrees."""
    values = table.values
    if "lat" in values and "lon" in values:
        return degrees_of(table.columns, values, table.path, content.notes), True
    north, east = ("north", "east") if "north" in values and "east" in values else ("y", "x")
    positions = np.column_stack([values[north], values[east]])
    known = positions[np.isfinite(positions).all(axis=1)]
    if options.crs:
        options.used.add("crs")
        return _from_system(table, (north, east), positions, options.crs, f"--crs {options.crs}"), True
    is_length = any(factor_of(table.columns[name].unit) for name in (north, east))
    if north == "y" and not is_length and len(known) and (np.abs(known).max(axis=0) <= (90.0, 180.0)).all():
        fine = (np.round(known, 3) != known).mean() > 0.5
        if fine and np.ptp(np.percentile(known, (25, 75), axis=0), axis=0).max() < _WIDE_DEG:
            return positions, True
        if fine:
            content.notes.append("x, y taken as metres: as degrees they would be hundreds of kilometres apart")
    given, positions, known = positions, *(_in_units_of(table, (north, east), rows, 1.0) for rows in (positions, known))
    if len(known) and np.abs(np.median(known, axis=0)).max() > FAR_M:
        middle = np.median(known, axis=0)
        stated = stated_crs(table, float(middle[0]))
        if stated.crs:
            content.notes.append(f"positions in {stated.crs}, by column {stated.names}")
            where = f"{table.path}: {stated.crs} of column {stated.names}"
            return _from_system(table, (north, east), given, stated.crs, where), True
        raise LogError(
            f"{table.path}: its coordinates are projected (about {middle[1]:,.0f} east, {middle[0]:,.0f} north). "
            f"{stated.cure}"
        )
    return positions, False


def _from_system(table: Table, names: Sequence[str], positions: Array, system: str, where: str) -> Array:
    """Latitude and longitude (n, 2) of positions (n, 2), north and east, in a coordinate system; `where` names it."""
    from pyproj import Transformer
    from pyproj.exceptions import ProjError

    try:
        turn = Transformer.from_crs(system, "EPSG:4326", always_xy=True)
    except ProjError as error:
        raise LogError(f"{where} is not a coordinate system; write it like --crs EPSG:32632.") from error
    crs = turn.source_crs
    if crs is not None and crs.is_projected:
        positions = _in_units_of(table, names, positions, crs.axis_info[0].unit_conversion_factor)
    lon, lat = turn.transform(positions[:, 1], positions[:, 0])
    return np.column_stack([lat, lon])


def _depths(table: Table, options: ReadOptions, content: LogContent) -> tuple[Array, Array, Reference]:
    """Depths of the water and of the vehicle (m), positive down, NaN where missing; and what the first begin at."""
    role = depth_role(table.columns)
    column, values = table.columns[role], np.array(table.values[role], dtype=float)
    options.used.add("depth_unit")
    factor = options.depth_unit_m or factor_of(column.unit)
    marked = np.isin(np.abs(values), _NO_DATA) & np.isfinite(values)
    content.left_out["depths with a value that marks missing data"] += int(marked.sum())
    values = np.where(marked, np.nan, values) * (factor or 1.0)
    content.left_out["depths that are not numeric"] += int((~np.isfinite(values) & ~marked).sum())
    stated = None if factor or column.unit.strip("- ") else _stated_units(table, column, content)
    content.notes.append(f"column {column.name}{_unit_note(column, factor) if stated is None else ''}")
    values = values if stated is None else values * stated
    known, own = values[np.isfinite(values)], np.zeros(len(values))
    if role == "depth":
        unit_m = (factor or 1.0) if stated is None else stated
        depths = content.downward(values)
        values = _below_surface(table, depths, unit_m, options, content)
        own = depths if values is not depths else own
    else:
        values = _from_elevations(table, column, role, values, known, options)
    absurd = np.abs(values) > DEEPEST_M
    content.left_out[f"depths beyond {DEEPEST_M:,.0f} m"] += int(absurd.sum())
    word = next((word for word in _BELOW if word in column.name.lower()), "")
    return np.where(absurd, np.nan, values), own, _BELOW.get(word, Reference.SURFACE)


def _below_surface(
    table: Table, depths: Array, unit_m: float | Array, options: ReadOptions, content: LogContent
) -> Array:
    """Depths of the water (m): those of a table, plus the heights above the bottom of a vehicle under water.

    A column without a height adds nothing, and heights that follow the depths are those of a boat's transducer, unless
    the user names the columns. Heights without a unit are in that of the depths, `unit_m`.
    """
    column, altitude = table.columns.get("above_bottom"), table.columns.get("altitude")
    if column is None:
        heights = table.values.get("altitude", np.empty(0))
        heights = heights[np.isfinite(heights)]
        if altitude is not None and len(heights) and 0.0 < heights.min() <= heights.max() < _LOW_M:
            content.questions.append(
                f"column {altitude.name} is not used. If it is the height above the bottom of a vehicle at the depth "
                f"{table.columns['depth'].name}, add it: --columns with depth and altitude in their places"
            )
        return depths
    is_same, heights = not column.unit.strip("- "), table.values["above_bottom"]
    factor = 0.0 if is_same else factor_of(column.unit) or options.depth_unit_m
    heights = np.where(np.isin(np.abs(heights), _NO_DATA) | ~(heights > 0.0), np.nan, heights)
    heights = heights * (unit_m if is_same else factor or 1.0)
    is_empty = bool(np.isnan(heights).all())
    if not options.columns and table.columns["depth"].role == "depth" and (is_empty or _follows(heights, depths)):
        why = "it has no height" if is_empty else "it follows the depth, as below a boat"
        content.notes.append(f"column {column.name} is not added: {why}")
        return depths
    unit = ", in the depths' unit" if is_same and np.any(unit_m != 1.0) else _unit_note(column, factor)
    content.notes.append(f"plus column {column.name}{unit}, the height above the bottom")
    missing = np.isfinite(depths) & np.isnan(heights)
    content.left_out[f"depths without a height above the bottom (column {column.name})"] += int(missing.sum())
    return depths + heights


def _follows(heights: Array, depths: Array) -> bool:
    """Whether heights above the bottom rise and fall with the depths (n,), as if both were depths of the water."""
    both = np.isfinite(heights) & np.isfinite(depths)
    if not both.any():
        return False
    apart, own = (values[both] - np.median(values[both]) for values in (depths - heights, depths))
    return bool(np.median(np.abs(apart)) < _FOLLOWS * np.median(np.abs(own)))


def _stated_units(table: Table, depth: Column, content: LogContent) -> Array | None:
    """Metres per unit of each row, (n,), from the depths' column of units; None without such a column."""
    roles = {c.number: role for role, c in table.columns.items() if role.startswith("depth_unit")}
    names = {number: table.columns[role].name for number, role in roles.items()}
    lengths = (*DEPTHS, "altitude")
    plain = {c.number for role, c in table.columns.items() if c.number not in names and role not in lengths}
    column = unit_column(names, depth.number, plain)
    if column is None:
        return None
    name, cells = names[column.number], np.char.strip(table.values[roles[column.number]])
    table.accounted.add(roles[column.number])
    stated = stated_units(cells, column)
    if stated is None:
        other = first_of(cells)
        content.notes.append(
            f"column {name} is ignored: {f'{other!r} is not a unit of depth' if other else 'it is empty'}"
        )
        return None
    unclear, silent = np.isnan(stated), np.array([is_unstated(cell) for cell in cells.tolist()])
    if unclear.all():
        raise LogError(
            f"{table.path}: column {name} has {first_of(cells)!r}, which is not a unit of depth. Give the unit, "
            "such as --depth-unit m."
        )
    if not column.is_clear and (stated != 1.0).any():
        raise LogError(
            f"{table.path}: the column {name}, with {first_of(cells[stated != 1.0])!r}, may state the unit of another "
            f"column than {depth.name}. Give the unit of the depths, such as --depth-unit m."
        )
    for cell in np.unique(cells[~unclear & ~silent]).tolist():
        content.notes.append(f"depths in {cell[:20]}, {stated_m(cell):g} m")
    content.left_out[f"depths without a unit in column {name}, where others have one"] += int((unclear & silent).sum())
    reason = f"depths in a unit that is not understood (column {name}, such as {first_of(cells[unclear & ~silent])!r})"
    content.left_out[reason] += int((unclear & ~silent).sum())
    return stated


def _unit_note(column: Column, factor: float) -> str:
    if factor:
        return "" if factor == 1.0 else f", {factor:g} m"
    if not column.unit.strip("- "):
        return ", in metres"
    return f", taken as metres: the unit {column.unit!r} is not understood (--depth-unit gives it)"


def _from_elevations(
    table: Table, column: Column, role: str, values: Array, known: Array, options: ReadOptions
) -> Array:
    """Depths from elevations, or from a column z that may be either."""
    surface_m = options.surface_m
    options.used.add("surface")
    if np.isfinite(surface_m):
        return surface_m - values
    if not len(known) or (known <= 0.0).mean() > 0.9:
        return -values
    low, high = float(known.min()), float(known.max())
    if role == "z" and low < 5.0:
        return values
    raise LogError(
        f"{table.path}: {column.name} is {low:.1f} to {high:.1f} m. If these are elevations, give that of the water "
        "surface with --surface M; if they are depths, name the column so with --columns."
    )
