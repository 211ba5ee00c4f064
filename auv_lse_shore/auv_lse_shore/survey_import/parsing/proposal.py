"""Names for the columns of a table from what their values look like: a proposal for `--columns`."""

import itertools
import re
from collections.abc import Sequence

import numpy as np

from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.sounding import DEEPEST_M
from auv_lse_gp.tables.column_names import column_of
from auv_lse_gp.tables.dialect import Dialect, is_number, numbers_of
from auv_lse_gp.tables.units import METRES
from auv_lse_shore.survey_import.parsing.times import days, of_day_s

#: Words in the names of columns of heights, of depths, and of either.
_HEIGHT_NAME = re.compile("elev|height|h(o|oe|ö)he|quota|cota", re.IGNORECASE)
DEPTH_NAME = re.compile("dep|sound|tief|prof|bathy", re.IGNORECASE)
_RANGE_NAME = re.compile(f"{DEPTH_NAME.pattern}|dist|range|{_HEIGHT_NAME.pattern}", re.IGNORECASE)
#: Roles for which the header is trusted.
_NAMED = ("lat", "lon", "quality", "depth_unit")


def proposal(dialect: Dialect, rows: Sequence[Sequence[str]]) -> list[str]:
    """Names for `--columns` from what the columns of a table look like; "-" for unknown ones.

    A header that names latitude and longitude is trusted, and a column with a depth's name is preferred for depths.
    """
    width = dialect.width
    header = [*dialect.header, *[""] * width][:width]
    texts = [[row[i] for row in rows if len(row) == width] for i in range(width)]
    values = [numbers_of(column, dialect.decimal_comma) for column in texts]
    names = ["-"] * width
    for i, column in enumerate(texts):
        names[i] = _time_name(column, values[i]) or "-"
    roles = [found.role if (found := column_of(i, title)) else "" for i, title in enumerate(header)]
    at = [i for i in range(width) if roles[i] in ("lat", "lon")]
    is_named = len(dialect.header) == width and sorted(roles[i] for i in at) == ["lat", "lon"]
    if is_named and _pair(values[at[0]], values[at[1]]):
        for role in set(roles) & set(_NAMED):
            names[roles.index(role)] = role
    free = [i for i in range(width) if names[i] == "-" and 2 * np.isfinite(values[i]).sum() > len(values[i])]
    behind = max(names.index("lat"), names.index("lon")) if {"lat", "lon"} <= set(names) else -1
    for a, b in itertools.pairwise(free) if behind < 0 else ():
        is_beside = all(name == "-" for name in names[a:b])  # with no time between, but perhaps hemispheres
        if is_beside and (pair := _pair(values[a], values[b])):
            named = roles[a], roles[b]
            names[a], names[b] = named if sorted(named) == sorted(pair) else pair
            free, behind = [i for i in free if i not in (a, b)], b
            break
    # depth comes after the position, if it can
    for i in sorted(free, key=lambda i: (not _RANGE_NAME.search(header[i]), i < behind, i)) if behind >= 0 else ():
        unit = _unit_of(dialect, i)
        if name := _depth_name(values[i] * METRES.get(unit, 1.0), header[i]):
            names[i] = f"{name}_{unit}".rstrip("_")
            free.remove(i)
            break
    for i in free if dialect.header and "quality" not in names else ():
        if _is_quality(values[i]) and any(name.startswith("depth") for name in names[:i]):
            names[i] = "quality"
            break
    return names


def _time_name(texts: Sequence[str], values: Array) -> str:
    text = next((t for t in texts if t.strip("- ")), "")
    if not is_number(text):
        if np.isfinite(of_day_s([text]))[0]:
            return "time"
        if np.isfinite(days([text], None)[0])[0]:
            return "date"
        return "datetime" if re.match(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}[T ,]", text) else ""
    known = values[np.isfinite(values)]
    if not len(known):
        return ""
    low, high = float(known.min()), float(known.max())
    for unit, factor in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if low * factor >= 3e8 and high * factor <= 4.2e9:
            return f"time_{unit}"
    return ""


def _pair(a: Array, b: Array) -> tuple[str, str] | None:
    """Whether two columns are latitude and longitude, or metres."""
    a, b = a[np.isfinite(a) & (a != 0.0)], b[np.isfinite(b) & (b != 0.0)]
    if not len(a) or not len(b):
        return None
    spans = float(np.ptp(a)), float(np.ptp(b))
    are_fine = any((np.round(values, 3) != values).mean() > 0.5 for values in (a, b))
    if max(spans) < 5.0 and are_fine:
        if np.abs(a).max() <= 90.0 and np.abs(b).max() <= 180.0:
            return "lat", "lon"
        if np.abs(a).max() <= 180.0 and np.abs(b).max() <= 90.0:
            return "lon", "lat"
    if min(np.abs(a).min(), np.abs(b).min()) > 1000.0 and max(spans) < 200_000.0:
        return "east", "north"
    return None


def _depth_name(values: Array, title: str) -> str:
    known = values[np.isfinite(values)]
    if len(np.unique(known)) < 2 or np.abs(known).max() > DEEPEST_M:
        return ""
    if (known <= 0.0).mean() > 0.9 or _HEIGHT_NAME.search(title):
        return "elevation"
    return "depth" if (known >= 0.0).mean() > 0.9 else ""


def _unit_of(dialect: Dialect, number: int) -> str:
    """The unit of length in a column's name or in the row of units; "" without one."""
    texts = [cells[number].lower() for cells in (dialect.header, dialect.units) if number < len(cells)]
    return next((word for word in re.findall("[a-z]+", " ".join(texts)) if word in METRES and word != "in"), "")


def _is_quality(values: Array) -> bool:
    known = values[np.isfinite(values)]
    return (
        len(np.unique(known)) > 2 and known.min() >= 0.0 and known.max() <= 100.0 and bool((known % 1.0 == 0.0).all())
    )
