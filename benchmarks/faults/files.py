"""Damages files that users bring, and reads them as area, as bathymetry and as log.

Each damaged file is read three times by a process of its own, which may take 20 s of processor time and 1 GB of
memory. It must end with content or with an error in a sentence: no other exception, no crash.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from auv_lse_common.support.option_types import whole_from
from benchmarks.faults.report import Report

SMALL = ("--files", "200")
_MISSIONS = Path(__file__).parents[2] / "config" / "missions"
#: Bounds of one file: processor time (s), and memory (bytes) beyond that of the readers themselves.
MOST_S, MOST_BYTES = 20, 1_000_000_000
_EXTREMES = (b"9" * 400, b"1e999", b"nan", b"-inf", b'"', b"\r\n\r\n", b",,,,", b"[" * 3000, b"<", b"\xff\xfe", b"null")
_ENDS = ("content", "refused", "broke")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options of this kind."""
    parser.add_argument("originals", nargs="*", type=Path, metavar="FILE", help="whole files to damage, of any format "
                        "(default: small ones of each format that needs no other program)")  # fmt: skip
    parser.add_argument("--files", type=whole_from(1), default=2000, metavar="N",
                        help="how many files to damage (default: %(default)s)")  # fmt: skip


def run(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Report:
    """Damages and reads files; those that broke a reader stay in `folder`."""
    warnings.simplefilter("ignore")
    folder.mkdir(parents=True, exist_ok=True)
    originals = list(options.originals) or list(_written(folder))
    rng = np.random.default_rng(options.seed)
    ends: Counter[str] = Counter()
    lost: list[str] = []
    slowest_s = 0.0
    for number in range(options.files):
        source = originals[number % len(originals)]
        path = folder / f"damaged-{number}{source.suffix}"
        path.write_bytes(damaged(source.read_bytes(), rng))
        found, took_s = _read_apart(path, folder / f"damaged-{number}.txt")
        slowest_s = max(slowest_s, took_s)
        if isinstance(found, str):
            lost.append(f"{path.name} ({source.name}): {found}")
            continue
        ends.update(found)
        path.unlink()
        if number % 100 == 99:
            say(f"{number + 1} of {options.files} files")
    table = ", ".join(f"{ends[end]} {end}" for end in _ENDS[:2])
    lines = [f"{options.files} files of {len(originals)} originals, read as area, bathymetry and log: {table}",
             f"slowest file {slowest_s:.1f} s of processor time"]  # fmt: skip
    return Report(lines, options.files, options.files - len(lost), lost=lost[:20])


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Bytes with some changed, removed, repeated, exchanged or replaced by extremes."""
    found = bytearray(data)
    for _ in range(rng.integers(1, 6)):
        at, size = int(rng.integers(0, max(len(found), 1))), int(rng.integers(1, 200))
        kind = rng.integers(0, 7)
        if kind == 0:
            found[at : at + 1] = bytes([rng.integers(0, 256)])
        elif kind == 1:
            del found[at : at + size]
        elif kind == 2:
            found[at:at] = found[at : at + size] * int(rng.integers(1, 20))
        elif kind == 3:
            found[at : at + size] = rng.bytes(size)
        elif kind == 4:
            found[at : at + 4] = (b"\xff\xff\xff\xff", b"\0\0\0\0", b"\xff\xff\xff\x7f")[rng.integers(0, 3)]
        elif kind == 5:
            found[at : at + size * int(rng.integers(0, 2))] = _EXTREMES[rng.integers(0, len(_EXTREMES))]
        else:
            del found[at:]
    return bytes(found)


def _read_apart(path: Path, report: Path) -> tuple[list[str] | str, float]:
    """How each reading of a file ended, or what broke; and the processor time (s) that it took."""
    _readers()  # loaded once, before the process divides
    before = time.monotonic()
    child = os.fork()
    if child == 0:
        _read_and_exit(path, report)
    _, status, usage = os.wait4(child, 0)
    took_s = usage.ru_utime + usage.ru_stime
    if os.WIFSIGNALED(status):
        return f"ended by signal {os.WTERMSIG(status)} after {time.monotonic() - before:.0f} s", took_s
    ends = json.loads(report.read_text())
    report.unlink()
    broken = next((text for end, text in ends if end == "broke"), "")
    return broken or [end for end, _ in ends], took_s


def _read_and_exit(path: Path, report: Path) -> None:
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        limit = pages * resource.getpagesize() + MOST_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        resource.setrlimit(resource.RLIMIT_CPU, (MOST_S, MOST_S))
        report.write_text(json.dumps([_end_of(read, path, errors) for read, errors in _readers()]))
        sys.stderr.flush()
    finally:
        os._exit(0)


def _end_of(read: Callable[[Path], object], path: Path, errors: tuple[type[Exception], ...]) -> tuple[str, str]:
    try:
        read(path)
    except errors as error:
        is_sentence = len(str(error)) < 2000 and "Traceback" not in str(error)
        return ("refused", "") if is_sentence else ("broke", f"a message of {len(str(error))} letters")
    except BaseException:  # whatever escapes is what is searched for
        return "broke", traceback.format_exc(limit=-3)
    return "content", ""


def _readers() -> list[tuple[Callable[[Path], object], tuple[type[Exception], ...]]]:
    """The readers of area, bathymetry and log, with the errors that end in a sentence."""
    from auv_lse_common.mission_file.parameters import ParameterError
    from auv_lse_mavlink.flight_logs import FlightLogError
    from auv_lse_shore.areas.area_file import read_area
    from auv_lse_shore.survey_import.gather import UserFacts, gather
    from auv_lse_shore.survey_import.survey_log import LogError
    from auv_lse_sim.ground.ground import GroundError
    from auv_lse_sim.ground.ground_files import load_ground

    def log(path: Path) -> object:
        return gather([path], UserFacts())

    return [
        (read_area, (ParameterError,)),
        (load_ground, (GroundError,)),
        (log, (LogError, FlightLogError)),
    ]


def _written(folder: Path) -> Iterator[Path]:
    """A small file of each format that needs no other program."""
    yield _MISSIONS / "lake.geojson"
    lake = _MISSIONS / "lake.nmea"
    log = folder / "log.nmea"
    log.write_bytes(lake.read_bytes()[:8000])
    yield log
    rng = np.random.default_rng(1)
    places = np.column_stack([46.5 + 0.01 * rng.random(60), 6.6 + 0.01 * rng.random(60), 5.0 + 20.0 * rng.random(60)])
    rows = [f"2026-06-14T10:{i // 60:02d}:{i % 60:02d}Z,{a:.6f},{b:.6f},{c:.2f}" for i, (a, b, c) in enumerate(places)]
    ring = " ".join(f"{b:.6f},{a:.6f},0" for a, b in [(46.5, 6.6), (46.5, 6.62), (46.52, 6.62), (46.5, 6.6)])
    points = "".join(f'<trkpt lat="{a:.6f}" lon="{b:.6f}"><extensions><depth>{c:.1f}</depth></extensions></trkpt>'
                     for a, b, c in places)  # fmt: skip
    features = [{"type": "Feature", "geometry": {"type": "Point", "coordinates": [b, a]},
                 "properties": {"depth": c, "time": f"2026-06-14T10:00:{i:02d}Z"}}
                for i, (a, b, c) in enumerate(places.tolist())]  # fmt: skip
    grid = "\n".join(" ".join(f"{v:.1f}" for v in row) for row in 5.0 + 20.0 * rng.random((12, 12)))
    texts = {
        "table.csv": "time_utc,lat,lon,depth_m\n" + "\n".join(rows),
        "area.kml": '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><name>lake</name>'
        f"<Polygon><outerBoundaryIs><LinearRing><coordinates>{ring}</coordinates></LinearRing></outerBoundaryIs>"
        "</Polygon></Placemark></kml>",
        "track.gpx": f'<gpx version="1.1"><trk><trkseg>{points}</trkseg></trk></gpx>',
        "csb.geojson": json.dumps({"type": "FeatureCollection", "features": features}),
        "area.waypoints": "QGC WPL 110\n" + "\n".join(f"{i}\t0\t3\t5001\t4\t0\t0\t0\t{a}\t{b}\t0\t1"
                                                     for i, (a, b, _) in enumerate(places[:4].tolist())),
        "grid.asc": f"ncols 12\nnrows 12\nxllcorner 0\nyllcorner 0\ncellsize 10\n{grid}\n",
    }  # fmt: skip
    for name, text in texts.items():
        (folder / name).write_text(text)
        yield folder / name
    yield from _rasters(folder, 5.0 + 20.0 * rng.random((12, 12)))


def _rasters(folder: Path, depth_m: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> Iterator[Path]:
    import rasterio

    size = {"height": depth_m.shape[0], "width": depth_m.shape[1], "crs": "EPSG:32632", "dtype": "float32"}
    at = rasterio.transform.from_origin(500_000.0, 5_200_000.0, 10.0, 10.0)
    for name, driver, bands in (("grid.tif", "GTiff", [-depth_m]), ("grid.bag", "BAG", [-depth_m, 0.0 * depth_m])):
        with rasterio.open(folder / name, "w", driver=driver, count=len(bands), transform=at, nodata=1e6, **size) as f:
            f.write(np.stack(bands).astype("float32"))
        yield folder / name
    np.savez(folder / "grid.npz", north_m=np.arange(12.0), east_m=np.arange(12.0), depth_m=depth_m)
    yield folder / "grid.npz"
