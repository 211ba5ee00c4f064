"""Crowdsourced bathymetry (IHO B-12, GeoJSON CSB 2.0 to 3.1), such as our own export."""

import json
import math
import re
from typing import Any

import numpy as np

from auv_lse_common.support.user_error import brief
from auv_lse_shore.survey_import.log_content import NO_POSITION, NOT_ON_EARTH, LogContent, Sounder
from auv_lse_shore.survey_import.log_file import LogFile, ReadOptions
from auv_lse_shore.survey_import.parsing.stated_units import StatedUnits
from auv_lse_shore.survey_import.parsing.times import datetimes
from auv_lse_shore.survey_import.parsing.vertical_reference import vertical_reference
from auv_lse_shore.survey_import.survey_log import LogError

_FEATURES = re.compile(r'"features"\s*:\s*\[')
_SKIP = re.compile(r"[\s,]*")
#: Features between two reports of progress.
_PIECE = 20_000
_NAN = float("nan")


def recognizes(file: LogFile) -> bool:
    """Whether it is a GeoJSON collection with depths."""
    head = file.head.lstrip(b"\xef\xbb\xbf \r\n\t")
    return head.startswith(b"{") and b"FeatureCollection" in head and b"depth" in head.lower()


def read(file: LogFile, options: ReadOptions) -> list[LogContent]:
    """Reads a collection: one log.

    Raises:
        LogError: if it is no GeoJSON, or several collections.
        OSError: if it cannot be read.
    """
    text, content = file.text, LogContent(file.path.name)
    match = _FEATURES.search(text)
    if match is None:
        raise LogError(f"{file.path} is a GeoJSON collection without features.")
    decode, at = json.JSONDecoder().raw_decode, match.end()
    stamps: list[str] = []
    rows, units = list[list[float]](), StatedUnits()
    while (at := _SKIP.match(text, at).end()) < len(text) and text[at] != "]":  # type: ignore[union-attr]
        try:
            feature, at = decode(text, at)
        except (ValueError, RecursionError) as error:
            if not rows:
                raise LogError(f"{file.path} is damaged GeoJSON ({brief(error)}). Copy it again.") from error
            content.left_out["features after the file is damaged or cut off"] += 1
            break
        row = _row(feature, units)
        if row is None:
            continue
        if isinstance(row, str):
            content.left_out[row] += 1
            continue
        stamps.append(row[0])
        rows.append(row[1])
        if len(rows) % _PIECE == 0:
            file.progress(at / len(text))
    if others := len(_FEATURES.findall(text, at)):
        raise LogError(f"{file.path} holds {others + 1} collections. Split it into one file each.")
    units.report(content)
    if rows:
        _fill(content, stamps, np.array(rows), text[: match.start()] + text[at:])
    return [content]


def _row(feature: Any, units: StatedUnits) -> tuple[str, list[float]] | str | None:
    """Time, and latitude, longitude, depth, and uncertainties east, north, vertical; or why it is left out.

    None for a depth in a unit that is not understood, which `units` counts.
    """
    try:
        properties, geometry = feature["properties"], feature["geometry"]
        if geometry["type"] != "Point":
            return f"features of the type {str(geometry['type'])[:20]}"
        position = [float(value) for value in geometry["coordinates"][:2]]
        factor = units.factor(properties)
        if math.isnan(factor):
            return None
        depth = float(properties["depth"]) * factor
        stamp = str(properties.get("time") or "")
        stated = properties.get("uncertainty") or []
        spread = [float(value) for value in stated] if isinstance(stated, list) else []
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError):
        return "features without a position or a depth"
    if len(position) != 2 or not (abs(position[1]) <= 90.0 and abs(position[0]) <= 360.0):
        return NOT_ON_EARTH
    if position == [0.0, 0.0]:
        return NO_POSITION
    return stamp, [position[1], position[0], depth, *(spread if len(spread) == 3 else [_NAN] * 3)]


def _fill(content: LogContent, stamps: list[str], rows: np.ndarray[Any, Any], about: str) -> None:
    """Adds positions and depths; times without a zone are UTC by the convention."""
    times = datetimes(stamps, None)[0]
    known = np.isfinite(times) & np.isfinite(rows[:, :3]).all(axis=1)
    content.left_out["features without a time"] += int((~known).sum())
    times, rows = times[known], rows[known]
    content.is_checked = '"auv_lse"' in about
    if len(rows) and np.isfinite(rows[:, 3:]).all():
        order = np.argsort(times, kind="stable")
        content.position_std_m = np.abs(rows[order][:, [4, 3]])
        content.depth_std_m = float(np.abs(rows[:, 5]).max())
    content.add_positions("features", np.column_stack([times, rows[:, :2]]))
    content.sounders["depth"] = Sounder(reference=vertical_reference(about, content))
    content.add_depths("depth", np.column_stack([times, content.downward(rows[:, 2]), np.full(len(rows), _NAN)]))
    if convention := re.search(r'"convention"\s*:\s*"([^"]{1,40})"', about):
        content.notes.append(f"convention {convention[1]}")
    content.lag_std_s = 0.3
