"""Recognizes a table's columns by name: the role of each, and its unit."""

import re
from collections.abc import Sequence
from typing import NamedTuple

from auv_lse_gp.tables.units import ANGLE_UNITS, METRES, OTHER_UNITS, TIME_UNITS, UNIT_NAMES


class Column(NamedTuple):
    """A column that is used.

    Attributes:
        number: Its number in the table.
        role: A key of `ROLES`.
        unit: The unit that its name or the row of units has; "" without one.
        rank: Rank of its name among those of its role, the best first.
    """

    number: int
    role: str
    unit: str
    name: str
    rank: int


#: Names of each role without blanks, signs and units; of several columns of a role the first name counts.
ROLES: dict[str, tuple[str, ...]] = {
    "lat": (
        "lat", "latitude", "latdeg", "latitudedeg", "gpslat", "gpslatitude", "poslat", "positionlat", "latwgs84",
        "latitudewgs84", "wgs84lat", "decimallatitude", "breite", "breitengrad", "geobreite", "latitud", "latitudine",
        "breddegrad", "breedtegraad", "szerokosc", "sirka", "shirota",
    ),
    "lon": (
        "lon", "longitude", "lng", "long", "londeg", "longitudedeg", "gpslon", "gpslong", "gpslng", "gpslongitude",
        "poslon", "positionlon", "lonwgs84", "longitudewgs84", "wgs84lon", "decimallongitude", "laenge", "lange",
        "länge", "laengengrad", "längengrad", "geolaenge", "longitud", "longitudine", "lengdegrad", "lengtegraad",
        "dlugosc", "delka", "dolgota",
    ),
    "lat_side": (
        "ns", "latns", "latitudens", "latdir", "latitudedir", "latdirection", "latitudedirection", "lathemisphere",
        "latitudehemisphere", "lathem", "latsign", "northsouth", "nsindicator", "nshemisphere", "hemispherens",
    ),
    "lon_side": (
        "ew", "lonew", "longew", "longitudeew", "londir", "longdir", "longitudedir", "londirection",
        "longitudedirection", "lonhemisphere", "longhemisphere", "longitudehemisphere", "lonhem", "lonsign", "eastwest",
        "ewindicator", "ewhemisphere", "hemisphereew",
    ),
    "lat_min": ("latmin", "latmins", "latminutes", "latitudemin", "latitudemins", "latitudeminutes"),
    "lon_min": (
        "lonmin", "lonmins", "lonminutes", "longmin", "longminutes", "longitudemin", "longitudemins",
        "longitudeminutes",
    ),
    "lat_sec": ("latsec", "latsecs", "latseconds", "latitudesec", "latitudesecs", "latitudeseconds"),
    "lon_sec": (
        "lonsec", "lonsecs", "lonseconds", "longsec", "longseconds", "longitudesec", "longitudesecs",
        "longitudeseconds",
    ),
    "north": ("north", "northing", "northings", "utmn", "utmnorthing", "utmy", "yutm", "nordwert", "hochwert", "n"),
    "east": ("east", "easting", "eastings", "utme", "utmeasting", "utmx", "xutm", "ostwert", "rechtswert", "e"),
    "depth": (
        "waterdepth", "bottomdepth", "totaldepth", "watercolumndepth", "depth", "sonardepth", "depthbelowsurface",
        "dep", "depthvalue", "instdep", "sounding", "depthcorrected", "correcteddepth", "depthsonar", "dbs",
        "depthbelowtransducer", "depthtransducer", "depthraw", "rawdepth", "dbt", "dpt", "tiefe", "wassertiefe",
        "profondeur", "profundidad", "profondita", "profundidade", "diepte", "dybde", "djup", "glebokosc", "hloubka",
        "depthbelowkeel", "dbk", "depth1", "glubina",
        "bathydepth", "corrdepth",
        "depthmean", "meandepth", "depthavg", "avgdepth", "averagedepth", "depthmedian", "mediandepth",
    ),
    "own_depth": (
        "vehicledepth", "owndepth", "rovdepth", "auvdepth", "subdepth", "depthvehicle", "depthrov", "depthauv",
    ),
    "above_bottom": (
        "abovebottom", "altitudeabovebottom", "heightabovebottom", "heightoffbottom", "altitudeaboveseafloor",
        "heightaboveseafloor", "heightaboveseabed", "altitudeaboveseabed", "distancetobottom", "bottomdistance",
        "rangetobottom", "dvlaltitude", "altimeter",
    ),
    "altitude": ("altitude", "alt", "rangefinder", "rangefinderdistance"),
    "depth_unit": UNIT_NAMES,
    "elevation": (
        "elevation", "elev", "bedelevation", "bottomelevation", "lakebedelevation", "bedlevel", "bottomlevel",
        "seafloorelevation", "elevationbottom", "bottomelev", "elevbottom", "bedelev", "seabedelevation", "sohlhoehe",
        "sohlhöhe",
    ),
    "datetime": (
        "datetime", "datetimeutc", "utcdatetime", "timestamp", "timeutc", "utctime", "timestamputc", "time", "caltime",
        "gpstime", "utc", "gmt", "recordedat", "createdat", "epoch", "unixtime", "unix", "unixtimestamp", "epochtime",
        "posixtime", "datumzeit", "zeitstempel", "fechahora", "horodatage", "datetimelocal", "localtime", "times",
        "zeit", "uhrzeit", "heure", "hora", "ora", "tid", "clock", "timelocal", "timeofday", "systemtime", "timeboot",
        "timesinceboot", "timesincestart", "elapsedtime", "timeelapsed", "elapsed", "datenum", "jd", "mjd",
        "time1", "pingtime", "secondsofday", "secofday", "headerstamp", "headerstampsec", "stamp", "stampsec",
    ),
    "gps_week": ("gpsweek", "gpswk", "gwk", "weeknumber", "week"),
    "of_week": (
        "gpstow", "tow", "itow", "timeofweek", "secondsofweek", "secofweek", "gpsseconds", "gpssec", "gpssow", "sow",
        "gms",
    ),
    "half_day": ("ampm", "pmam"),
    "utc_offset": ("utcoffset", "gmtoffset", "timezoneoffset", "tzoffset", "timezone", "tz"),
    "year": ("year", "yyyy", "yr", "yy"),
    "month": ("month", "mon", "mo"),
    "day_of_year": ("dayofyear", "yearday", "doy", "jday", "julianday"),
    "hour": ("hour", "hours", "hh", "hr"),
    "minute": ("minute", "minutes", "min", "mins"),
    "second": ("second", "seconds", "sec", "secs", "ss"),
    "date": (
        "date", "utcdate", "dateutc", "gpsdate", "pingdate", "day", "datum", "fecha", "data", "localdate", "jour",
        "dato",
    ),
    "quality": (
        "confidence", "quality", "signalquality", "depthquality", "pingconfidence", "depthconfidence", "pingquality",
        "echoquality", "conf", "sonarquality", "depthconf",
    ),
    "sounder": (
        "sounder", "channel", "transducer", "sonar", "sonarid", "sensor", "sensorid", "instance", "channelid",
        "sonarchannel", "transducerid", "sounderid", "beam", "beamnumber", "frequency", "surveytype",
    ),
    "vehicle": ("vehicle", "vessel", "boat", "platform", "vehicleid"),
    "north_std": ("northstd",),
    "east_std": ("eaststd",),
    "tvu": ("tvu",),
    "order": ("s44order",),
    "vertical_datum": ("verticaldatum",),
    "epsg": ("epsg", "epsgcode", "crs", "srid", "srs", "coordinatesystem"),
    "utm_zone": ("utmzone", "zone", "zoneutm"),
    "hemisphere": ("hemisphere", "hemi", "utmhemisphere"),
    "x": ("x", "xcoord", "xcoordinate", "pointx", "coordx"),
    "y": ("y", "ycoord", "ycoordinate", "pointy", "coordy"),
    "z": ("z", "zcoord", "value", "zvalue"),
}  # fmt: skip
#: Roles of columns that make latitudes and longitudes.
ANGLES = tuple(f"{angle}{part}" for angle in ("lat", "lon") for part in ("", "_min", "_sec", "_side"))
#: Roles of columns that depths are read from, the best first.
DEPTHS = ("depth", "elevation", "z")
_BY_NAME = {name: role for role, names in ROLES.items() for name in names}
#: A zone in the header of a column, such as "UTC+2".
HEADER_ZONE = re.compile(r"(?<![a-z])(?:utc|gmt)\s*([+-])\s*(0?\d|1[0-4])(?::?(\d{2}))?(?!\d)", re.IGNORECASE)
#: The name of a zone there, whose offset is not known.
HEADER_ZONE_NAME = re.compile(
    r"(?<=[ _(\[-])(MES?Z|(CE|EE|WE)S?T|[BI]ST|(E|C|M|P|AK|H|AE|AC|AW|NZ|J)ST|(E|C|M|P|AK|AE|AC|NZ)DT|MSK)\b"
)
#: Hemispheres, and minutes and seconds, where the unit of a latitude or longitude stands.
_SIDES = {"lat": ("n", "s", "north", "south"), "lon": ("e", "w", "east", "west")}
_PARTS = {
    "min": "_min", "mins": "_min", "minutes": "_min", "'": "_min",
    "sec": "_sec", "secs": "_sec", "seconds": "_sec", '"': "_sec", "''": "_sec",
}  # fmt: skip
#: Vertical datums, as in Depth_MLLW and ELEV_NAVD88_FT.
_DATUM = re.compile(
    r"navd(88)?|ngvd(29)?|igld(55|85|2020)?|mllw|mlw|msl|cgvd(28|2013)|ln02|lhn95|dhhn(92|2016)?|nhn|nap|nn2000|rh2000"
    r"|n2000|dvr90|bscd2000|evrf(2000|2007|2019)?|ign69|odn|ahd|egm(84|96|2008)"
)
#: As in "depth in feet".
_PREPOSITION = re.compile(r"[\s_]+in[\s_]+(?=[a-z]+$)")
#: As in LonW.
_SIDE_AT_END = re.compile(r"(?<=[a-z])(?=[NSEW]$)")
#: The sounder's frequency by which a depth was measured.
_FREQUENCY = re.compile(r"[(\[\s_]*(?:\d{2,3}[\s_]*khz|(?<![a-z])[hl]f)(?![a-z])[)\]]?")
_BRACKETS = re.compile(r"[(\[{]([^)\]}]*)[)\]}]")
#: Letters for them, which are also names of their own in orders of a date and a time, as in YYYY,MM,DD,HH,MM,SS.
_LETTERS = {"year": "y", "month": "m", "date": "d", "hour": "h", "minute": "m", "second": "s"}
_ORDERS = re.compile("ymd|dmy|mdy|hms?")
_IN_ORDERS = {"y", "m", "mm", "d", "dd", "h", "s"}


def column_of(number: int, name: str, unit: str = "") -> Column | None:
    """The column that a name means; None if it is not used."""
    text = _SIDE_AT_END.sub(" ", HEADER_ZONE_NAME.sub("", name.strip().strip("\"'")))
    text = _PREPOSITION.sub(" ", HEADER_ZONE.sub("utc", _FREQUENCY.sub("", text.lower())))
    if match := _BRACKETS.search(text):
        unit = match[1].strip()
        text = _BRACKETS.sub("", text)
    words = [word for word in re.split(r"[^a-z0-9äöüß°%]+", text) if word]
    words = words[:1] + [word for word in words[1:] if not _DATUM.fullmatch(word)]
    key = "".join(words)
    if key not in _BY_NAME:  # a unit at the end, also without a sign before it: DepthFt, TimeMs
        known = [*METRES, *TIME_UNITS, *ANGLE_UNITS, *OTHER_UNITS]
        known.sort(key=lambda k: [k] != words[-1:])  # lon_grad is no long_rad
        cut = next((k for k in known if key.endswith(k) and _suits(k, key[: -len(k)])), "")
        key, unit = key.removesuffix(cut), unit or cut
    if key not in _BY_NAME and words[-1:] and words[-1] in _SIDES.get(_BY_NAME.get("".join(words[:-1]), ""), ()):
        key, unit = "".join(words[:-1]), words[-1]  # as in "lon W"
    role, unit = _BY_NAME.get(key), unit.lower().strip()
    if role is None:
        return None
    rank = ROLES[role].index(key)
    return Column(number, role + _PARTS.get(unit, "") if role in _SIDES else role, unit, name.strip(), rank)


def _suits(unit: str, key: str) -> bool:
    """Whether a column of this name can have this unit: the `min` of a depth is no minute."""
    role = _BY_NAME.get(key)
    is_time = role in ("datetime", "utc_offset", "of_week")
    if unit in METRES:
        return role is not None and not is_time and role not in _LETTERS
    return is_time if unit in TIME_UNITS else role is not None


def named_columns(names: Sequence[str], units: Sequence[str] = ()) -> dict[str, Column]:
    """The column of each role; of several columns, that of the role's first name, of depths one with a unit.

    A second time or depth has the role with its rank added: "datetime", "datetime1".
    """
    found: dict[str, list[Column]] = {}
    for number, (name, meaning) in enumerate(zip(names, _spelled_out(names), strict=True)):
        bracket = next(filter(_BRACKETS.fullmatch, names[number + 1 : number + 2]), "")  # above a column of units
        column = column_of(number, meaning + bracket, units[number] if number < len(units) else "")
        if column:
            found.setdefault(column.role, []).append(column._replace(name=name.strip()))
    columns = {}
    for role, entries in found.items():
        for i, column in enumerate(sorted(entries, key=lambda c: (c.rank, role in DEPTHS and not c.unit, c.number))):
            columns[role if not i else f"{role}{i}"] = column
    return columns


def _spelled_out(names: Sequence[str]) -> list[str]:
    """The names, with those of the parts of dates and times where letters in a common order name them."""
    keys = [name.strip().strip("\"'").lower() for name in names]
    alone = _IN_ORDERS - {"y"} if "x" in keys else _IN_ORDERS
    letters = "".join(key[0] if key in alone else _LETTERS.get(_BY_NAME.get(key, ""), "-") for key in keys)
    meanings = [*names]
    for match in _ORDERS.finditer(letters):
        other = "minute" if "y" in match[0] else "month"
        of_letter = {letter: role for role, letter in _LETTERS.items() if role != other}
        meanings[match.start() : match.end()] = [of_letter[letter] for letter in match[0]]
    return meanings
