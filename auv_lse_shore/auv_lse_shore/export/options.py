"""Options of auv_lse export and auv_lse adjust that describe a survey."""

import argparse
import dataclasses
import datetime
import math
import re
from pathlib import Path

import numpy as np

from auv_lse_common.support.arrays import Array
from auv_lse_gp.no_data import OFTEN_NO_DATA, is_no_data
from auv_lse_gp.tables.column_names import Column
from auv_lse_gp.tables.table_error import TableError
from auv_lse_gp.tables.whole_table import whole_table
from auv_lse_shore.export.survey import USUAL_SOUNDER_SPEED_MPS, Survey, SurveyError, Uncertainties

#: Names of the uncertainties on the command line, and their fields.
_STDS = {
    "sounder": "sounder_m",
    "pressure": "pressure_m",
    "sound-speed": "sound_speed_mps",
    "water-level": "water_level_m",
}
#: A value that often marks missing data is taken for such if it is farther than this (m, m/s) from the others' median.
_APART = 20.0
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
    group.add_argument(
        "--datum",
        default="",
        metavar="NAME",
        help='vertical datum of the depths, near the water surface, such as LAT or "LN02 372 m"',
    )
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
        help="sound speed set in the sounder during the dive (default: %(default)g); needs --sound-speed",
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
    if options.sounder_speed != USUAL_SOUNDER_SPEED_MPS and options.sound_speed is None:
        raise SurveyError(
            f"--sounder-speed {options.sounder_speed:g} corrects depths only together with --sound-speed, the speed in "
            "the water. Add it"
        )
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
    """Rows of two columns of a table, by increasing first column; a time in UTC becomes seconds."""
    try:
        table = whole_table(path)
        names = [re.sub(r"\W+", "_", name.lower()).strip("_") for name in table.dialect.header]
        first = next((name for name in firsts if name in names), "")
        if not first or second not in names:
            raise SurveyError(
                f"{option} {path} has the columns {', '.join(table.dialect.header) or 'none'}; needed is a CSV file "
                f"with columns {' or '.join(firsts)}, {second}"
            )
        key = "date" if first == "time_utc" else first
        columns = {role: Column(names.index(n), role, "", n, 0) for role, n in ((key, first), (second, second))}
        table = dataclasses.replace(table, columns=columns)
        values = table.read([key, second])
        if key == "date":
            values[key] = np.array([_utc_s(text) for text in values[key].tolist()])
            table.check(np.isfinite(values[key]), key, "Write a time such as 2026-06-14T09:00:00Z")
        table.check(~is_no_data(values[second]), second, "This is a common mark for missing data. Remove this line")
        table.check((values[key] >= 0.0) | (key != "depth_m"), key, "Write depths positive down")
    except TableError as error:
        raise SurveyError(f"{option} {error}") from error
    order = np.argsort(values[key], kind="stable")
    found: Array = np.column_stack([values[key], values[second]])[order]
    repeats = np.diff(found[:, 0]) == 0.0
    for row in np.flatnonzero(repeats & (np.diff(found[:, 1]) != 0.0))[:1].tolist():
        raise SurveyError(
            f"{option} {table.where(order[row + 1])}: {second} is {found[row + 1, 1]:g} at the same {first} as in "
            f"{table.where(order[row])}, where it is {found[row, 1]:g}. Remove one"
        )
    found, order = found[np.append(True, ~repeats)], order[np.append(True, ~repeats)]
    marks = np.isin(np.abs(found[:, 1]), OFTEN_NO_DATA)
    if (marks & (found[:, 1] < 0.0) & (found[:, 1] == found[0, 1])).all():
        raise SurveyError(
            f"{option} {path} has only levels of {found[0, 1]:g}, a common mark for missing data. Correct the table, "
            f"or give a level that does not change as a number: --water-level {found[0, 1]:g}"
        )
    marks &= np.abs(found[:, 1] - np.median(found[~marks | marks.all(), 1])) > _APART
    if marks.any():
        raise SurveyError(
            f"{option} {table.where(order[marks][0])}: {second} is {found[marks][0, 1]:g}, far from the others and a "
            "common mark for missing data. Remove this line"
        )
    return found


def _utc_s(text: str) -> float:
    """Seconds since 1970 of an ISO 8601 time, UTC unless it names another zone; NaN for another text."""
    try:
        time = datetime.datetime.fromisoformat(text.strip().replace("Z", "+00:00"))
    except ValueError:
        return math.nan
    return (time if time.tzinfo else time.replace(tzinfo=datetime.UTC)).timestamp()
