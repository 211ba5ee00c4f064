"""GPX tracks and waypoints with depths in their extensions, as plotters and Garmin devices write them."""

from __future__ import annotations

import io
from xml.etree.ElementTree import Element, ParseError, iterparse

import numpy as np

from auv_lse_shore.survey_import.log_content import Clock, LogContent, Reference
from auv_lse_shore.survey_import.log_file import LogFile, ReadOptions
from auv_lse_shore.survey_import.parsing.times import datetimes
from auv_lse_shore.survey_import.survey_log import LogError

#: Names of extensions that hold a depth (m), without their namespace.
_DEPTHS = ("depth", "waterdepth", "water_depth")
_POINTS = ("trkpt", "wpt", "rtept")


def recognizes(file: LogFile) -> bool:
    """Whether it is GPX."""
    return b"<gpx" in file.head[:4096]


def read(file: LogFile, options: ReadOptions) -> list[LogContent]:
    """Reads a file: one log of its tracks, or of its waypoints if it has no tracks with depths.

    Raises:
        LogError: if it is not XML.
        OSError: if it cannot be read.
    """
    found: dict[str, list[tuple[str, list[float]]]] = {name: [] for name in _POINTS}
    content = LogContent(file.path.name)
    data = file.data
    stream = io.BytesIO(data)
    try:
        for number, (_, element) in enumerate(iterparse(stream)):
            name = element.tag.rpartition("}")[2]
            if name in _POINTS:
                _add(content, found[name], element)
                element.clear()
            elif name == "trkseg":
                element.clear()
            if number % 20_000 == 0:
                file.progress(stream.tell() / max(len(data), 1))
    except (ParseError, RecursionError, LookupError, ValueError) as error:
        if not any(found.values()):
            raise LogError(f"{file.path} is damaged GPX ({error}). Copy it again.") from error
        content.left_out["points after the file is damaged or cut off"] += 1
    points = next((rows for rows in found.values() if any(row[1][2] == row[1][2] for row in rows)), None)
    if points is None:
        count = sum(map(len, found.values()))
        raise LogError(f"{file.path} has {count} points without a depth. Export them with depths from the plotter.")
    _fill(content, points)
    return [content]


def _add(content: LogContent, rows: list[tuple[str, list[float]]], point: Element) -> None:
    """Adds a point: its time, latitude, longitude and depth (NaN: none)."""
    depth, stamp = float("nan"), ""
    try:
        place = [float(point.attrib["lat"]), float(point.attrib["lon"])]
        for child in point.iter():
            name = child.tag.rpartition("}")[2].lower()
            if name in _DEPTHS and child.text:
                depth = float(child.text.replace(",", "."))
            elif name == "time":
                stamp = (child.text or "").strip()
    except (KeyError, ValueError):
        content.left_out["points that are incomplete"] += 1
        return
    rows.append((stamp, [*place, depth]))


def _fill(content: LogContent, points: list[tuple[str, list[float]]]) -> None:
    """Adds positions and depths, with times or as numbered points."""
    times = datetimes([stamp for stamp, _ in points], None)[0]
    rows = np.array([row for _, row in points])
    if not np.isfinite(times).mean() > 0.5:
        content.clock, times = Clock.NONE, np.arange(len(rows), dtype=float)
    timeless = ~np.isfinite(times)
    content.left_out["points without a time"] += int(timeless.sum())
    for stamp_s, (lat, lon, _) in zip(times[~timeless].tolist(), rows[~timeless].tolist(), strict=True):
        content.position("points", stamp_s, lat, lon)
    with_depth = ~timeless & np.isfinite(rows[:, 2])
    if content.clock is Clock.NONE:
        with_depth &= (rows[:, :2] != 0.0).any(axis=1)
    content.add_depths("depth", np.column_stack([times, rows[:, 2], np.full(len(rows), np.nan)])[with_depth])
    for sounder in content.sounders.values():
        sounder.reference = Reference.SURFACE
    content.lag_std_s = 0.5
