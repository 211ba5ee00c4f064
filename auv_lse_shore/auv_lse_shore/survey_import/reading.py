"""Finds the files of a survey, and the reader of each by its content."""

import glob
import re
import shlex
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from auv_lse_shore.survey_import.formats import formats
from auv_lse_shore.survey_import.log_content import LogContent
from auv_lse_shore.survey_import.log_file import LogFile, ReadOptions
from auv_lse_shore.survey_import.survey_log import LogError, Progress

#: Files of a folder that are never logs.
_NO_LOGS = (".md", ".png", ".jpg", ".jpeg", ".pdf", ".yaml", ".yml", ".html", ".prj", ".idx", ".son")

#: How files of other programs begin, at the byte of the second number, and what they are.
_OTHERS = (
    (rb"ULog\x01\x12\x35", 0, "a PX4 log (ULog)"),
    (rb"\x89MCAP0", 0, "a ROS 2 recording (MCAP). One of this stack needs no import: auv_lse export RUN reads it"),
    (rb"SQLite format 3\0", 0, "a database, such as a ROS 2 recording (.db3) or a GeoPackage"),
    (rb"#ROSBAG V", 0, "a ROS 1 recording"),
    (rb"\x00\x00\x27\x0a", 0, "a shapefile"),
    (rb"\xd0\xcf\x11\xe0", 0, "an Excel workbook"),
    (rb"\.FIT", 8, "a Garmin activity (FIT)"),
    (rb"FTP (NEW|OLD)\b", 0, "a raw file of Hypack"),
    (rb"\* Sea-Bird\b", 0, "a CTD cast of Sea-Bird, whose depths are the probe's and not the bottom's"),
    (rb"\x7b[\x00-\x08]", 0, "a sonar recording (XTF)"),
    (rb"\x00\x00\x02[1-9A-Za-z]", 2, "a multibeam recording of Kongsberg (.all)"),
    (rb"\x00#[A-Z]{3}[\x00-\x08]", 3, "a multibeam recording of Kongsberg (.kmall)"),
    (rb"[\s\S]{0,4}GSF-v", 8, "a multibeam recording (GSF)"),
    (rb"\xff\xff\x00\x00", 4, "a multibeam recording of Teledyne (.s7k)"),
    (rb"\x7f\x7f", 0, "a recording of a Doppler log or current profiler (PD0)"),
    (rb"BR[\s\S]{2}\x0a\x00", 0, "a sonar recording of SonarView (.svlog)"),
    (rb"\xc3\x40{1,2}\xf1", 0, "a recording of a sub-bottom profiler (SEG-Y)"),
    (rb"LASF[\s\S]{20}\x01", 0, "a point cloud (LAS)"),
    (rb"\x01\x16[\x0a-\x1f]", 0, "a sonar recording of EdgeTech (JSF)"),
    (rb"\xb5\x62[\x01\x02]", 0, "a recording of a u-blox receiver (UBX)"),
    (rb"\d{5}[123]LE1", 0, "an electronic chart (S-57)"),
    (rb"QGC WPL \d", 0, "a mission of QGroundControl"),
    (rb"%PDF-\d", 0, "a PDF"),
    (rb"\s*<(\?xml|!DOCTYPE|html|kml)", 0, "XML or a web page"),
    (rb"\s*(\{\s*[\"}]|\[\s*[\[{])", 0, "JSON in another form than crowdsourced bathymetry"),
)

#: How archives begin.
_ARCHIVE = re.compile(rb"PK\x03\x04|7z\xbc\xaf|Rar!")
#: How grids begin: (Geo)TIFF, netCDF, HDF5 (BAG, S-102), ESRI ASCII, Surfer.
_GRID = re.compile(rb"II[*+]\0|MM\0[*+]|CDF[\x01\x02\x05]|\x89HDF\r\n|DS(?:AA\s|BB|RB)|(?i:ncols)\s+\d")


def files_of(names: Iterable[Path]) -> tuple[list[Path], bool]:
    """The files of folders, patterns and names, each once; and whether all of them were named one by one.

    Raises:
        LogError: if a folder or a pattern has no files.
    """
    files: dict[Path, Path] = {}
    all_named = True
    for name in names:
        found = [name]
        if name.is_dir():
            all_named = False
            found = sorted(p for p in name.rglob("*") if p.is_file() and not p.name.startswith(".") and _may_be_log(p))
        elif not name.exists() and any(sign in str(name) for sign in "*?["):
            all_named = False
            found = sorted(Path(path) for path in glob.glob(str(name), recursive=True) if Path(path).is_file())
        if not found:
            raise LogError(f"{name}: no files there.")
        for path in found:
            files.setdefault(path.resolve(), path)
    return list(files.values()), all_named


def _may_be_log(path: Path) -> bool:
    return path.suffix.lower() not in _NO_LOGS


def read_logs(path: Path, options: ReadOptions, progress: Progress) -> list[LogContent]:
    """Reads a file of any known format: one log, or one of each vehicle in it.

    Raises:
        LogError, FlightLogError: if it cannot be used; names the file, what is wrong, and the cure.
        MissingPackageError: if pymavlink is needed, and missing.
        OSError: if it cannot be read.
    """
    file = LogFile(path, progress)
    if not file.head.strip(b"\0 \r\n\t"):
        raise LogError(f"{path} is empty. Copy it again.")
    if _ARCHIVE.match(file.head):
        raise LogError(f"{path} is an archive, or a spreadsheet. Unpack it, or save it as CSV.")
    if _GRID.match(file.head):
        raise LogError(
            f"{path} is a grid or a picture, not a log. A grid of depths is the ground of a simulated mission: "
            f"auv_lse mission --bathymetry {shlex.quote(str(path))}"
        )
    for module in formats():
        if getattr(module, "ASKED_LAST", False):
            _refuse_others(path, file.head)
        if module.recognizes(file):
            contents: list[LogContent] = module.read(file, options)
            if file.is_cut_off:
                contents[0].notes.append("the gzip file is damaged or cut off: what follows is missing")
            return contents
    raise LogError(f"{path} is of no format that can be read. See the formats with auv_lse import --help.")


def _refuse_others(path: Path, head: bytes) -> None:
    """Raises LogError for a file of another program, also one whose text has columns."""
    begin = head.removeprefix(b"\xef\xbb\xbf")
    if what := next((what for pattern, at, what in _OTHERS if re.compile(pattern).match(begin, at)), ""):
        raise LogError(
            f"{path} is {what}. Export positions and depths as one table (CSV) with time, lat, lon and depth."
        )


def read_all(
    paths: list[Path], all_named: bool, options: ReadOptions, progress: Callable[[Path, float], None]
) -> Iterator[list[LogContent] | str]:
    """The contents of each file, or why a file of a folder or pattern is left out.

    Raises:
        LogError, FlightLogError: if a file that was named cannot be used.
    """
    for path in paths:

        def of_file(share: float, path: Path = path) -> None:
            progress(path, share)

        try:
            yield read_logs(path, options, of_file)
        except (ValueError, OSError) as error:
            if all_named:
                raise
            yield f"left out: {error}" if str(path) in str(error) else f"left out: {path}: {error}"
