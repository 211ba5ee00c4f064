"""Damaged files of every format end in soundings or in one sentence, soon and in bounded memory.

`AUV_LSE_DAMAGED=2000` in the environment tries so many files instead of a few.
"""

from __future__ import annotations

import gzip
import os
import re
import resource
import threading
import time
import zipfile

import numpy as np
import pytest
from adjust.survey_logs import ORIGIN, dataflash, depth_m, nmea, survey, telemetry
from adjust.test_binary_logs import LOGS, humminbird, lowrance
from adjust.test_table_logs import TABLES

from auv_lse_mavlink.flight_logs import FlightLogError
from auv_lse_shore.survey_import.choice import Choice
from auv_lse_shore.survey_import.command import parser, user_facts
from auv_lse_shore.survey_import.gather import UserFacts, gather
from auv_lse_shore.survey_import.log_file import HEAD
from auv_lse_shore.survey_import.survey_log import LogError
from benchmarks.faults.files import damaged

ROWS = survey()[:80]
FILES = int(os.environ.get("AUV_LSE_DAMAGED", "120"))
#: Bounds of one file: seconds, and bytes of the whole process beyond what it had before.
MOST_S, MOST_BYTES = 20.0, 1_000_000_000


def originals(folder):
    logs = {name: make(ROWS) for name, make in LOGS.items()}
    logs |= {f"{name}.csv": text if isinstance(text, bytes) else text.encode() for name, text in TABLES.items()}
    logs |= {"a.nmea": nmea(ROWS).encode(), "a.bin": dataflash(ROWS).data, "a.tlog": telemetry(ROWS)}
    logs["R00001.DAT"] = humminbird(ROWS, folder)
    logs["B001.SON"] = (folder / "R00001" / "B001.SON").read_bytes()
    return logs


def test_damaged_files_end_in_one_sentence(tmp_path):
    logs, rng = originals(tmp_path), np.random.default_rng(20260614)
    names = sorted(logs)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    ended = {"read": 0, "refused": 0}
    for number in range(FILES):
        name = names[number % len(names)]
        path = tmp_path / name
        path.write_bytes(damaged(logs[name], rng))
        options = parser().parse_args([str(path), "--draught", "0.3"])
        start = time.process_time()
        try:
            found = gather(options.logs, user_facts(options))
            assert all(np.isfinite(log.soundings).all() for log in found.placed), (number, name)
            ended["read"] += 1
        except (LogError, FlightLogError) as error:
            ended["refused"] += 1
            if "\n" in str(error):
                pytest.fail(f"file {number} ({name}): {error!r} has several lines")
        except Exception as error:
            (tmp_path / "failed").write_bytes(path.read_bytes())
            pytest.fail(f"file {number} ({name}): {error!r}; see {tmp_path / 'failed'}")
        assert time.process_time() - start < MOST_S, (number, name)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 - before < MOST_BYTES
    assert ended["read"] > 0.3 * FILES
    assert ended["refused"] > 0


def test_a_gzip_file_of_several_parts_is_read_to_its_end(tmp_path):
    data = nmea(ROWS).encode()
    cut = data.index(b"\n", len(data) // 2) + 1
    path = tmp_path / "a.nmea.gz"
    path.write_bytes(gzip.compress(data[:cut]) + gzip.compress(data[cut:]) + b"\0" * 512)
    found = gather([path], user_facts(parser().parse_args([str(path)])))
    (tmp_path / "a.nmea").write_bytes(data)
    whole = gather([tmp_path / "a.nmea"], user_facts(parser().parse_args([str(path)])))
    assert found.placed[0].soundings.tolist() == whole.placed[0].soundings.tolist()
    assert "cut off" not in " ".join(found.lines)


@pytest.mark.parametrize("end", ["cut", "garbage"])
def test_the_missing_end_of_a_gzip_file_is_reported(tmp_path, end):
    packed = gzip.compress(nmea(ROWS).encode())
    path = tmp_path / "a.nmea.gz"
    path.write_bytes(packed[: len(packed) * 3 // 4] if end == "cut" else packed + b"garbage")
    found = gather([path], user_facts(parser().parse_args([str(path)])))
    assert "the gzip file is damaged or cut off: what follows is missing" in found.lines[0]


@pytest.mark.parametrize("packed", [False, True])
def test_a_pipe_is_read_once_and_whole(tmp_path, packed):
    data = nmea(survey()).encode()
    assert len(data) > HEAD  # the beginning is not read a second time
    path = tmp_path / "pipe"
    os.mkfifo(path)
    writer = threading.Thread(target=path.write_bytes, args=(gzip.compress(data) if packed else data,))
    writer.start()
    found = gather([path], user_facts(parser().parse_args([str(path)])))
    writer.join()
    assert len(found.placed[0].soundings) == len(survey())


def test_what_follows_a_damaged_byte_is_read(tmp_path):
    """A wrong type of message, or a wrong size of a ping, costs that one and not the rest of the log."""
    rows = survey()[:200]
    packed = dataflash(rows).data
    at = packed.index(b"\xa3\x95\x84", len(packed) // 3)  # RFND
    assert len(soundings_of(tmp_path / "a.bin", packed[: at + 2] + b"\xee" + packed[at + 3 :])) >= 198
    dat = humminbird(rows, tmp_path)
    sound = tmp_path / "R00001" / "B001.SON"
    pings = sound.read_bytes()
    at = pings.index(b"\xa0\0\0\0\x08", len(pings) // 3)
    sound.write_bytes(pings[: at + 1] + b"\x7f" + pings[at + 2 :])
    assert len(soundings_of(tmp_path / "R00001.DAT", dat)) >= 198
    for version, size_at in ((2, 28), (3, 8)):
        frames = lowrance(rows, version)
        length = (len(frames) - 8) // 400
        at = 8 + 130 * length + size_at
        damaged = frames[:at] + b"\xff\xff" + frames[at + 2 :]
        assert len(soundings_of(tmp_path / f"a.sl{version}", damaged)) >= 198


@pytest.mark.parametrize("name", ["a.tlog", "a.sl2", "R00001.DAT"])
def test_a_log_that_ends_within_a_message_is_reported(tmp_path, name):
    rows = survey()[:60]
    if name == "R00001.DAT":
        data = humminbird(rows, tmp_path)
        sound = tmp_path / "R00001" / "B001.SON"
        sound.write_bytes(sound.read_bytes()[:-30])
    else:
        data = {"a.tlog": telemetry, "a.sl2": lowrance}[name](rows)[:-30]
    (tmp_path / name).write_bytes(data)
    lines = "\n".join(gather([tmp_path / name], UserFacts()).lines)
    assert re.search(
        r"left out: \d+ (damaged pieces?|messages? that (are|is) cut off|pings? that (are|is) incomplete)", lines
    )


@pytest.mark.parametrize("lost", [5, 13, 40, 400])
def test_a_piece_of_a_telemetry_log_begins_within_a_message(tmp_path, lost):
    """As `split` cuts a log that is too large."""
    assert len(soundings_of(tmp_path / "a.tlog", telemetry(survey()[:60])[lost:])) >= 54


def test_a_telemetry_log_may_begin_with_the_lines_that_an_autopilot_prints_while_it_boots(tmp_path):
    """As MAVProxy logs them, each with its time, between messages."""
    rows, data = survey()[:60], b""
    for i in range(len(rows)):
        log = telemetry(rows[i : i + 1])
        data += (log[:8] + b"Init Gyro*\n" if i < 8 else b"") + log
    assert len(soundings_of(tmp_path / "a.tlog", data)) == 60


def test_what_is_lost_behind_a_lowrance_log_s_damage_is_counted_in_bytes(tmp_path):
    """Its frames begin with their position: those behind an insertion or of a second log are not found."""
    data, begin, length = lowrance(survey()[:60]), 8 + 60 * (144 + 20), 144 + 20
    (tmp_path / "a.sl2").write_bytes(data[:begin] + b"more" + data[begin:])
    lines = gather([tmp_path / "a.sl2"], UserFacts()).lines
    assert f"- left out: {60 * length + 4:,} bytes after the log is damaged or cut off" in lines


def soundings_of(path, data):
    """The soundings of a damaged log, all of them at the known depth."""
    path.write_bytes(data)
    (log,) = gather([path], UserFacts(origin=ORIGIN, choice=Choice(draught_m=0.3))).placed
    assert log.soundings[:, 3] == pytest.approx(depth_m(*log.soundings[:, 1:3].T), abs=0.12)
    return log.soundings


@pytest.mark.parametrize("first", ["nr, #ROW", "LASF", "nr of <gpx"])
def test_a_table_that_begins_like_the_file_of_another_program_is_read(tmp_path, first):
    path = tmp_path / "table.csv"
    rows = [f"{i},{46.5 + 1e-5 * i:.6f},6.6,{3.0 + 0.1 * i:.2f},{1718000000 + i}" for i in range(40)]
    columns = first.count(",") * "0,"
    path.write_text("\n".join([f"{first},lat,lon,depth,time", *(columns + row for row in rows)]))
    (log,) = gather([path], UserFacts()).placed
    assert len(log.soundings) == 40


GRIDS = {
    "a.tif": b"II*\0\x08\0",
    "a.bag": b"\x89HDF\r\n\x1a\n",
    "a.nc": b"CDF\x02\0\0",
    "a.asc": b"ncols 3\nnrows 2\n",
    "surfer.grd": b"DSAA\n4 2\n9.2 9.3\n47.5 47.6\n5 9\n5 6 7 8\n6 7 8 9\n",
}


@pytest.mark.parametrize("name", GRIDS)
def test_a_grid_is_no_log(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(GRIDS[name])
    with pytest.raises(LogError, match=rf"a grid or a picture, not a log\..* auv_lse mission --bathymetry \S*{name}$"):
        gather([path], UserFacts())


def test_an_archive_names_its_cure(tmp_path):
    path = tmp_path / "day.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.nmea", nmea(ROWS))
    with pytest.raises(LogError, match=r"day\.zip is an archive, or a spreadsheet\. Unpack it, or save it as CSV\."):
        gather([path], UserFacts())


OTHERS = {
    "a.ulg": (b"ULog\x01\x12\x35\x01", "a PX4 log"),
    "a.mcap": (b"\x89MCAP0\r\n", r"a ROS 2 recording \(MCAP\).*auv_lse export RUN"),
    "a.db3": (b"SQLite format 3\0", "a database, such as a ROS 2 recording"),
    "a.bag": (b"#ROSBAG V2.0\n", "a ROS 1 recording"),
    "a.shp": (b"\0\0\x27\x0a" + 20 * b"\0", "a shapefile"),
    "a.xls": (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "an Excel workbook"),
    "a.xtf": (b"\x7b\x01Hypack\0\0", "a sonar recording"),
    "a.all": (b"\xc8\0\0\0\x02\x49\xfe\x0b", r"a multibeam recording of Kongsberg \(\.all\)"),
    "a.kmall": (b"\xf4\x01\0\0#IIP\0", r"a multibeam recording of Kongsberg \(\.kmall\)"),
    "a.jsf": (b"\x01\x16\x0d\x00\x50\x00", r"a sonar recording of EdgeTech \(JSF\)"),
    "a.ubx": (b"\xb5\x62\x01\x07\x5c\x00", r"a recording of a u-blox receiver \(UBX\)"),
    "a.000": (b"015763LE1 0900201", r"an electronic chart \(S-57\)"),
    "a.waypoints": (b"QGC WPL 110\n0\t1\t0", "a mission of QGroundControl"),
    "a.txt": (b"%PDF-1.4\n", "a PDF"),
    "a.gsf": (b"\0\0\0\x0c\0\0\0\x01GSF-v03.09\0\0", r"a multibeam recording \(GSF\)"),
    "checked.gsf": (b"\0\0\0\x0c\x80\0\0\x01\x12\x34\x56\x78GSF-v03.09", r"a multibeam recording \(GSF\)"),
    "a.s7k": (b"\x05\0\x3c\0\xff\xff\0\0", "a multibeam recording of Teledyne"),
    "a.pd0": (b"\x7f\x7f\x0e\x03", r"a recording of a Doppler log or current profiler \(PD0\)"),
    "a.svlog": (b"BR\x10\x01\x0a\0\0\0{", "a sonar recording of SonarView"),
    "a.sgy": ("C 1 CLIENT".encode("cp037"), "a recording of a sub-bottom profiler"),
    "a.las": (b"LASF" + 20 * b"\0" + b"\x01\x04", "a point cloud"),
    "a.fit": (b"\x0e\x10\xd9\x07\x00\x00\x00\x00.FIT", "a Garmin activity"),
    "a.cnv": (b"* Sea-Bird SBE 9 Data File:\n*END*\n 1 47.5 9.2 5.0\n 2 47.6 9.3 5.1\n", "a CTD cast"),
    "a.kml": (b'<?xml version="1.0"?><kml>', "XML"),
    "page.csv": (b"<!DOCTYPE html><html><body>1, 2, 3", "XML"),
    "a.jsonl": (b'{"t": 1, "lat": 46.5}\n{"t": 2, "lat": 46.5}\n', "JSON"),
    "a.json": (b'[\n  {"t": 1, "lat": 46.5}]', "JSON"),
}


@pytest.mark.parametrize("name", OTHERS)
def test_files_of_other_programs_are_named(tmp_path, name):
    begin, words = OTHERS[name]
    (tmp_path / name).write_bytes(begin + b"\n" * 20 + bytes(300))
    with pytest.raises(LogError, match=rf"{name} is {words}.*Export positions and depths as one table \(CSV\)"):
        gather([tmp_path / name], UserFacts())
    with pytest.raises(LogError, match=rf"left out: .*{name}.*{words}"):  # the only file of a folder
        gather([tmp_path], UserFacts())


def test_headers_in_brackets_are_those_of_tables(tmp_path):
    path, rows = tmp_path / "a.csv", TABLES["plain"].partition("\n")[2]
    path.write_text("<utc>,<lat>,<lon>,<depth>\n" + rows)
    assert len(gather([path], UserFacts()).placed[0].soundings) == 120
    path.write_text("[utc],[lat],[lon],[depth]\n" + rows)
    with pytest.raises(LogError, match=r"the columns \[utc\].*By their values they look like: --columns"):
        gather([path], UserFacts())


@pytest.mark.parametrize("write", [telemetry, nmea])
def test_a_clock_that_is_set_back_in_a_log_is_reported(tmp_path, write):
    rows = survey()[:400]
    rows[200:, 0] -= 50.0
    data = write(rows)
    (tmp_path / "a.log").write_bytes(data.encode() if isinstance(data, str) else data)
    lines = "\n".join(gather([tmp_path / "a.log"], UserFacts()).lines)
    assert "- question: its clock was set back by 49 s, so parts of the log have the same times" in lines


@pytest.mark.parametrize("write", [telemetry, nmea])
def test_parts_whose_times_do_not_overlap_are_not_called_mixed(tmp_path, write):
    rows = survey()[:400]
    rows[:200, 0] += 3600.0  # the end of summer time
    data = write(rows)
    (tmp_path / "a.log").write_bytes(data.encode() if isinstance(data, str) else data)
    lines = "\n".join(gather([tmp_path / "a.log"], UserFacts()).lines)
    assert "- question: its clock was set back by 3,599 s: the times before or after it may be wrong" in lines
    assert "mixed" not in lines


def test_a_log_without_a_sounding_at_a_usable_position_is_refused(tmp_path):
    """The gate has nothing to begin with then."""
    data = "lat,lon,depth\n10,20,\n10,20.001,\n" + "".join(f"46.5,6.6{n:02d},5.{n:02d}\n" for n in range(40))
    (tmp_path / "a.csv").write_text(data)
    with pytest.raises(LogError, match=r"none of 40 depths has a usable position .*farther than 200 km"):
        gather([tmp_path / "a.csv"], user_facts(parser().parse_args(["a.csv", "--origin", "10", "20"])))
