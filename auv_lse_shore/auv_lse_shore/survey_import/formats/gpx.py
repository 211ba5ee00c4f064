"""GPX tracks and waypoints with depths in their extensions, as plotters and Garmin devices write them."""

from array import array
from xml.etree.ElementTree import ParseError, XMLParser

import numpy as np

from auv_lse_common.support.arrays import Array
from auv_lse_common.support.user_error import brief
from auv_lse_shore.survey_import.log_content import Clock, LogContent, Reference, Sounder
from auv_lse_shore.survey_import.log_file import LogFile, ReadOptions
from auv_lse_shore.survey_import.parsing.stated_units import StatedUnits
from auv_lse_shore.survey_import.parsing.times import datetimes
from auv_lse_shore.survey_import.survey_log import LogError

#: Names of extensions that hold a depth (m, or in a unit that they state), without their namespace.
_DEPTHS = ("depth", "waterdepth", "water_depth")
_POINTS = ("trkpt", "wpt", "rtept")
#: Bytes that are parsed at once.
_AT_ONCE = 1 << 20


def recognizes(file: LogFile) -> bool:
    """Whether it is GPX: a table may mention it, but not in a line of markup."""
    return any(b"<gpx" in line and line.strip(b"\xef\xbb\xbf \t")[:1] == b"<" for line in file.head[:4096].splitlines())


def read(file: LogFile, options: ReadOptions) -> list[LogContent]:
    """Reads a file: one log of its tracks, or of its waypoints if it has no tracks with depths.

    Raises:
        LogError: if it is not XML, or several files.
        OSError: if it cannot be read.
    """
    content, points = LogContent(file.path.name), _Points()
    parser, data = XMLParser(target=points), file.data
    try:
        for start in range(0, len(data), _AT_ONCE):
            parser.feed(data[start : start + _AT_ONCE])
            file.progress(start / len(data))
        parser.close()
    except (ParseError, RecursionError, LookupError, ValueError) as error:
        if (files := data.count(b"</gpx>")) > 1:
            raise LogError(f"{file.path} holds {files} GPX files. Split it into one file each.") from error
        if not any(points.stamps.values()):
            raise LogError(f"{file.path} is damaged GPX ({brief(error)}). Copy it again.") from error
        content.left_out["points after the file is damaged or cut off"] += 1
    content.left_out["points that are incomplete"] += points.incomplete
    points.units.report(content)
    for name, stamps in points.stamps.items():
        rows = np.frombuffer(points.rows[name], dtype=float).reshape(-1, 3)
        if np.isfinite(rows[:, 2]).any():
            _fill(content, stamps, rows)
            return [content]
    why = " in a known unit. Export depths in metres" if points.units.unclear else "; elevations (<ele>) are not depths"
    raise LogError(f"{file.path} has {sum(map(len, points.stamps.values()))} points without a depth{why}.")


class _Points:
    """The points of each kind: their times, and rows (latitude, longitude deg, depth m or NaN) one after another.

    A parser calls `start`, `data` and `end`, so that no tree of a large file is kept.
    """

    def __init__(self) -> None:
        self.stamps: dict[str, list[str]] = {name: [] for name in _POINTS}
        self.rows = {name: array("d") for name in _POINTS}
        self.incomplete, self.units, self._factor = 0, StatedUnits(), 1.0
        self._names: dict[str, str] = {}
        self._point: dict[str, str] | None = None  # what is known of the current point
        self._text: list[str] = []

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """An element begins."""
        name = self._names.setdefault(tag, tag.rpartition("}")[2])
        if name in self.rows:
            self._point = attributes
        if name.lower() in _DEPTHS:  # Humminbird's own are centimetres, unless they state another unit
            self._factor = self.units.factor({**attributes, "UOM": "cm"} if "humminbird" in tag.lower() else attributes)
        self._text = []

    def data(self, text: str) -> None:
        """Text of an element."""
        self._text.append(text)

    def end(self, tag: str) -> None:
        """An element ends."""
        point, name = self._point, self._names[tag]
        if point is None:
            return
        if name in self.rows:
            self._point = None
            self._add(name, point)
        elif (key := name.lower()) == "time" or key in _DEPTHS:
            point["time" if key == "time" else "depth"] = "".join(self._text)

    def _add(self, name: str, point: dict[str, str]) -> None:
        try:
            depth = float(point.get("depth", "nan").strip().replace(",", ".") or "nan") * self._factor
            self.rows[name].extend((float(point["lat"]), float(point["lon"]), depth))
        except (KeyError, ValueError):
            self.incomplete += 1
        else:
            self.stamps[name].append(point.get("time", "").strip())


def _fill(content: LogContent, stamps: list[str], rows: Array) -> None:
    """Adds positions and depths, with times or as numbered points."""
    times = datetimes(stamps, None)[0]
    if not np.isfinite(times).mean() > 0.5:
        content.clock, times = Clock.NONE, np.arange(len(rows), dtype=float)
    timeless = ~np.isfinite(times)
    content.left_out["points without a time"] += int(timeless.sum())
    content.add_positions("points", np.column_stack([times, rows[:, :2]])[~timeless])
    is_there = (rows[:, :2] != 0.0).any(axis=1) | (content.clock is not Clock.NONE)
    with_depth = ~timeless & np.isfinite(rows[:, 2]) & is_there
    pings = np.column_stack([times, content.downward(rows[:, 2]), np.full(len(rows), np.nan)])
    content.sounders["depth"] = Sounder(reference=Reference.SURFACE)
    content.add_depths("depth", pings[with_depth])
    content.lag_std_s = 0.5
