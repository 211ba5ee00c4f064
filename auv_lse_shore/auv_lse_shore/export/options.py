"""Options of auv_lse export and auv_lse adjust that describe a survey."""

from __future__ import annotations

import argparse
import csv
import datetime
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from auv_lse_gp.no_data import is_no_data
from auv_lse_shore.export.survey import USUAL_SOUNDER_SPEED_MPS, Survey, SurveyError, Uncertainties

Array = NDArray[np.float64]

#: Names of the uncertainties on the command line, and their fields.
_STDS = {
    "sounder": "sounder_m",
    "pressure": "pressure_m",
    "sound-speed": "sound_speed_mps",
    "water-level": "water_level_m",
}
#: Largest number of contour levels.
_MAX_LEVELS = 1000


def add_survey_options(p: argparse.ArgumentParser) -> None:
    """Adds the options."""
    group = p.add_argument_group("survey")
    group.add_argument(
        "--water-level",
        metavar="M|CSV",
        help="height of the water surface above the datum: a number, or a table (time_s or time_utc, level_m); it is "
        "subtracted from every depth",
    )
    group.add_argument("--datum", default="", metavar="NAME", help='vertical datum of the depths, such as "LN02"')
    group.add_argument(
        "--sound-speed",
        metavar="MPS|CSV",
        help="sound speed in the water: a number, or a profile (depth_m, sound_speed_mps); it corrects every depth",
    )
    group.add_argument(
        "--sounder-speed",
        type=float,
        default=USUAL_SOUNDER_SPEED_MPS,
        metavar="MPS",
        help="sound speed set in the sounder during the dive (default: %(default)g)",
    )
    group.add_argument(
        "--std",
        nargs="+",
        default=[],
        metavar="NAME=VALUE",
        help="standard deviations for the total uncertainties: sounder (m; default gp.noise_std_m), pressure (0.05 m), "
        "sound-speed (5 m/s), water-level (0.05 m)",
    )
    group.add_argument(
        "--origin", nargs=2, type=float, metavar=("LAT", "LON"), help="WGS84 latitude and longitude (deg) of the "
        "mission's local coordinates, where its file has none",
    )  # fmt: skip
    group.add_argument(
        "--crs", default="", metavar="CRS", help="coordinate system of chart.tif and chart.bag (default: the UTM zone)"
    )
    group.add_argument("--contours", default="", metavar="M,M,...", help="depths of the lines in contours.geojson")
    group.add_argument("--contour-interval", type=float, metavar="M", help="interval of further lines")
    group.add_argument(
        "--provider", nargs=2, metavar=("NAME", "EMAIL"), help="who submits soundings_b12_auvN.geojson; without it, "
        "they are not written",
    )  # fmt: skip


def survey_of(options: argparse.Namespace) -> Survey:
    """The survey that options describe.

    Raises:
        SurveyError: naming the option.
        OSError: if a file cannot be read.
    """
    sources = {}
    for name, given in (("water level", options.water_level), ("sound speed", options.sound_speed)):
        if given is not None:
            sources[name] = "constant" if _number(given) is not None else Path(given).name
    if not 1000.0 <= options.sounder_speed <= 2000.0:
        raise SurveyError(f"--sounder-speed must be 1000 to 2000 m/s, not {options.sounder_speed:g}")
    interval = options.contour_interval
    if interval is not None and not (math.isfinite(interval) and interval > 0.0):
        raise SurveyError(f"--contour-interval must be more than 0 m, not {interval:g}")
    return Survey(
        water_level=_water_level(options.water_level),
        datum=options.datum.strip(),
        sound_speed=_sound_speed(options.sound_speed),
        sounder_speed_mps=options.sounder_speed,
        std=_uncertainties(options.std),
        origin=None if options.origin is None else _origin(*options.origin),
        crs=_crs(options.crs.strip()),
        contour_levels_m=_levels(options.contours),
        contour_interval_m=interval or 0.0,
        provider=None if options.provider is None else _provider(*options.provider),
        sources=sources,
    )


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _uncertainties(pairs: list[str]) -> Uncertainties:
    values = {}
    for pair in pairs:
        name, _, text = pair.partition("=")
        value = _number(text)
        if name not in _STDS or value is None or value < 0.0:
            raise SurveyError(f"--std: {pair} is not NAME=VALUE with a NAME of {', '.join(_STDS)} and a VALUE >= 0")
        values[_STDS[name]] = value
    return Uncertainties(**values)


def _origin(latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
    if not (abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0):
        swapped = " Are they swapped?" if abs(longitude_deg) <= 90.0 and abs(latitude_deg) <= 180.0 else ""
        raise SurveyError(
            f"--origin: latitude {latitude_deg:g}, longitude {longitude_deg:g} is not a position in degrees.{swapped}"
        )
    return latitude_deg, longitude_deg


def _crs(name: str) -> str:
    """The name of a coordinate system, or ""."""
    if not name:
        return ""
    from pyproj import CRS  # slow to import, and rarely needed
    from pyproj.exceptions import CRSError

    try:
        crs = CRS.from_user_input(name)
        crs = crs.sub_crs_list[0] if crs.is_compound else crs
        if not (crs.is_projected or crs.is_geographic):
            raise SurveyError(f"--crs: {name} has no horizontal coordinates, as EPSG:32632 has")
    except CRSError as error:
        raise SurveyError(f"--crs: {name} is not a coordinate system, such as EPSG:32632 ({error})") from error
    return name


def _provider(name: str, email: str) -> tuple[str, str]:
    if not name.strip() or not all(part.strip() for part in email.partition("@")):
        raise SurveyError(f"--provider: {name!r}, {email!r} are not a name and an e-mail address")
    return name.strip(), email.strip()


def _levels(text: str) -> tuple[float, ...]:
    parts = [part for part in text.split(",") if part.strip()]
    levels = [_number(part) for part in parts]
    if None in levels or len(levels) > _MAX_LEVELS:
        raise SurveyError(f"--contours: {text} cannot be used; give at most {_MAX_LEVELS} depths, such as 5,10,15")
    return tuple(sorted({level for level in levels if level is not None}))


def _water_level(given: str | None) -> Array | None:
    if given is None:
        return None
    if (constant := _number(given)) is not None:
        return np.array([[0.0, constant]])
    return _table(Path(given), "--water-level", ("time_s", "time_utc"), "level_m")


def _sound_speed(given: str | None) -> Array | None:
    if given is None:
        return None
    constant = _number(given)
    profile = np.array([[0.0, constant]]) if constant is not None else None
    if profile is None:
        profile = _table(Path(given), "--sound-speed", ("depth_m",), "sound_speed_mps")
    low, high = profile[:, 1].min(), profile[:, 1].max()
    if low < 1000.0 or high > 2000.0:
        values = f"{low:g}" if low == high else f"{low:g} to {high:g}"
        raise SurveyError(f"--sound-speed must be within 1000 to 2000 m/s, not {values}")
    return profile


def _table(path: Path, option: str, firsts: tuple[str, ...], second: str) -> Array:
    """Rows of two columns of a CSV file, by increasing first column."""
    needed = f"needed is a CSV file with columns {' or '.join(firsts)}, {second}"
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            first = next((name for name in firsts if name in (reader.fieldnames or ())), None)
            if first is None or second not in (reader.fieldnames or ()):
                columns = ", ".join(reader.fieldnames or ()) or "none"
                raise SurveyError(f"{option} {path} has the columns {columns}; {needed}")
            rows = []
            for row in reader:
                value = _utc_s(row[first]) if first == "time_utc" else _number(row[first] or "")
                level = _number(row[second] or "")
                where, unclear = f"{option} {path}:{reader.line_num}", first if value is None else second
                if value is None or level is None:
                    cure = "a time such as 2026-06-14T09:00:00Z" if unclear == "time_utc" else "a number"
                    raise SurveyError(f"{where}: {unclear} is {row[unclear]!r}; write {cure}")
                if is_no_data(level):
                    raise SurveyError(
                        f"{where}: {second} is {level:g}, a common mark for missing data. Remove this line"
                    )
                if first == "depth_m" and value < 0.0:
                    raise SurveyError(f"{where}: depth_m is {value:g} m; write depths positive down")
                rows.append((value, level))
    except (csv.Error, UnicodeDecodeError) as error:
        raise SurveyError(f"{option} {path}: {error}; {needed}") from error
    table = np.array(rows).reshape(-1, 2)
    if not len(table) or (np.diff(table[:, 0]) <= 0.0).any():
        raise SurveyError(f"{option} {path} has {len(table)} rows; {needed}, in increasing order, each value once")
    return table


def _utc_s(text: str | None) -> float | None:
    """Seconds since 1970 of an ISO 8601 time, UTC unless it names another zone."""
    try:
        time = datetime.datetime.fromisoformat((text or "").strip().replace("Z", "+00:00"))
    except ValueError:
        return None
    return (time if time.tzinfo else time.replace(tzinfo=datetime.UTC)).timestamp()
