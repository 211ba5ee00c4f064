"""Damages files that users bring, and reads them as area, as bathymetry and as log.

Each damaged file is read three times by a process of its own, which may take 20 s of processor time and 1 GB of
memory. It must end with content or with an error in a sentence: no other exception, no crash.
"""

import argparse
import json
import os
import resource
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from auv_lse_common.support.option_types import whole_from
from benchmarks.command import existing_file
from benchmarks.faults.bed.originals import small_files
from benchmarks.faults.report import Report

SMALL = ("--files", "200")
#: Bounds of one file: processor time (s), and memory (bytes) beyond that of the readers themselves.
MOST_S, MOST_BYTES = 20, 1_000_000_000
_EXTREMES = (b"9" * 400, b"1e999", b"nan", b"-inf", b'"', b"\r\n\r\n", b",,,,", b"[" * 3000, b"<", b"\xff\xfe", b"null")
_ENDS = ("content", "refused", "broke")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options of this kind."""
    parser.add_argument("originals", nargs="*", type=existing_file, metavar="FILE",
                        help="whole files to damage, of any format (default: small ones of 16 formats)")  # fmt: skip
    parser.add_argument("--files", type=whole_from(1), default=2000, metavar="N",
                        help="how many files to damage (default: %(default)s)")  # fmt: skip


def run(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Report:
    """Damages and reads files; those that broke a reader stay in `folder`."""
    warnings.simplefilter("ignore")
    folder.mkdir(parents=True, exist_ok=True)
    originals = list(options.originals) or list(small_files(folder))
    rng = np.random.default_rng(options.seed)
    ends: Counter[str] = Counter()
    lost: list[str] = []
    slowest_s = 0.0
    for number in range(options.files):
        source = originals[number % len(originals)]
        path = folder / f"damaged-{number}{source.suffix}"
        path.write_bytes(damaged(source.read_bytes(), rng))
        found, took_s = _read_in_process(path, folder / f"damaged-{number}.txt")
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


def _read_in_process(path: Path, report: Path) -> tuple[list[str] | str, float]:
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
