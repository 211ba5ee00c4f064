"""Lowrance, Humminbird, WIBL, GPX and crowdsourced GeoJSON logs, and ArduPilot's with several sounders."""

from __future__ import annotations

import gzip
import json
import struct
from datetime import UTC, datetime

import numpy as np
import pytest
from adjust.survey_logs import START_S, Dataflash, dataflash, depth_m, nmea, survey, telemetry

from auv_lse_mavlink.flight_logs import FlightLogError
from auv_lse_shore.survey_import.command import parser, user_facts
from auv_lse_shore.survey_import.gather import gather
from auv_lse_shore.survey_import.survey_log import LogError

ROWS = survey()[:120]
POLAR_M, HUMMINBIRD_M = 6_356_752.3142, 6_378_388.0


def lowrance(rows, version=2, created_s=START_S):
    """SL2 or SL3: a primary channel with depths in feet, and a side scan of the same pings."""
    data = struct.pack("<4H", version, version - 1, 3200, version - 2)  # as in real logs
    for stamp, lat, lon, depth in rows:
        x = round(POLAR_M * np.radians(lon))
        y = round(POLAR_M * np.log(np.tan(np.radians(45.0 + lat / 2.0))))
        for channel in (0, 5):
            length, echoes = (144, 20) if version == 2 else (168, 20)
            frame = bytearray(length + echoes)
            feet, ms = depth / 0.3048 + channel, round(1000 * (stamp - created_s))
            if version == 2:
                places = ((28, "H", length + echoes), (32, "H", channel), (60, "I", int(created_s)), (64, "f", feet),
                          (108, "i", x), (112, "i", y), (132, "H", 0x10), (140, "i", ms))  # fmt: skip
            else:
                places = ((8, "H", length + echoes), (12, "H", channel), (40, "I", int(created_s)), (48, "f", feet),
                          (92, "i", x), (96, "i", y), (116, "H", 0x10), (124, "i", ms))  # fmt: skip
            struct.pack_into("<I", frame, 0, len(data))
            for at, kind, value in places:
                struct.pack_into(f"<{kind}", frame, at, value)
            data += bytes(frame)
    return data


def humminbird(rows, folder):
    """A .DAT file with its folder of one .SON file; depths are decimetres."""
    dat = bytearray(64)
    struct.pack_into(">I", dat, 20, int(START_S))
    dat[32:42] = b"R00001.SON"
    (folder / "R00001").mkdir()
    sound = b""
    for stamp, lat, lon, depth in rows:
        x = round(HUMMINBIRD_M * np.radians(lon))
        geocentric = np.arctan(np.tan(np.radians(lat)) / 1.0067642927)
        y = round(HUMMINBIRD_M * np.log(np.tan(np.pi / 4 + geocentric / 2)))
        values = ((0x80, 1), (0x81, round(1000 * (stamp - START_S))), (0x82, x), (0x83, y), (0x87, round(10 * depth)))
        sound += b"\xc0\xde\xab\x21" + b"".join(struct.pack(">Bi", tag, value) for tag, value in values)
        sound += struct.pack(">BB", 0x50, 1) + struct.pack(">BI", 0xA0, 8) + b"\x21" + b"\0" * 8
    (folder / "R00001" / "B001.SON").write_bytes(sound)
    return bytes(dat)


def wibl(rows):
    """A WIBL log: its version, positions as NMEA sentences, depths as NMEA 2000 packets."""
    data = struct.pack("<II", 0, 22) + struct.pack("<HH9H", 1, 3, *range(9))
    days = int(START_S // 86_400)
    lines = [line for line in nmea(rows).splitlines() if "DBT" not in line]
    for i, (stamp, _, _, depth) in enumerate(rows):
        elapsed = round(1000 * (stamp - START_S))
        for line in lines[2 * i : 2 * i + 2]:
            body = struct.pack("<I", elapsed) + line.encode() + b"\r\n"
            data += struct.pack("<II", 10, len(body)) + body
        body = struct.pack("<HdIddd", days, stamp % 86_400.0, elapsed, depth, 0.0, 100.0)
        data += struct.pack("<II", 3, len(body)) + body
    return data


def moment(stamp_s):
    return f"{datetime.fromtimestamp(stamp_s, UTC):%Y-%m-%dT%H:%M:%S}Z"


def gpx(rows):
    points = "".join(
        f'<trkpt lat="{lat:.8f}" lon="{lon:.8f}"><time>{moment(t)}</time><extensions><gpxtpx:TrackPointExtension>'
        f"<gpxtpx:depth>{depth:.3f}</gpxtpx:depth></gpxtpx:TrackPointExtension></extensions></trkpt>"
        for t, lat, lon, depth in rows
    )
    return (
        '<?xml version="1.0"?><gpx xmlns="http://www.topografix.com/GPX/1/1" version="1.1" '
        'xmlns:gpxtpx="http://www.garmin.com/xmlschemas/TrackPointExtension/v2">'
        f"<trk><trkseg>{points}</trkseg></trk></gpx>"
    ).encode()


def crowdsourced(rows):
    features = [
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": [lon, lat]},
            "properties": {"depth": depth, "time": moment(t)[:-1] + ".000000"},
        }
        for t, lat, lon, depth in rows
    ]
    return json.dumps(
        {"type": "FeatureCollection", "properties": {"convention": "CSB 2.0"}, "features": features}
    ).encode()


LOGS = {
    "a.sl2": lowrance,
    "a.sl3": lambda rows: lowrance(rows, 3),
    "a.wibl": wibl,
    "a.gpx": gpx,
    "a.geojson": crowdsourced,
    "a.nmea.gz": lambda rows: gzip.compress(nmea(rows).encode()),
}


def gathered(path, *arguments):
    options = parser().parse_args([str(path), "--origin", "46.5", "6.6", "--draught", "0.3", *arguments])
    return gather(options.logs, user_facts(options))


@pytest.mark.parametrize("name", LOGS)
def test_each_format_gives_the_known_depths(tmp_path, name):
    path = tmp_path / f"{name}.log"  # what counts is the content
    path.write_bytes(LOGS[name](ROWS))
    (log,) = gathered(path).placed
    assert len(log.soundings) == len(ROWS)
    assert log.soundings[0, 0] == pytest.approx(START_S, abs=0.5)
    # 7 cm: Lowrance's positions have whole metres, on ground of 5 cm per metre and a hump
    assert log.soundings[:, 3] == pytest.approx(depth_m(*log.soundings[:, 1:3].T), abs=0.07)


@pytest.mark.parametrize("version", [2, 3])
def test_pings_before_the_moment_at_which_a_lowrance_log_was_created_keep_their_times(tmp_path, version):
    path = tmp_path / "a.log"  # three of nine real recordings begin some 0.5 s before it
    path.write_bytes(lowrance(ROWS, version, created_s=START_S + 2))
    (log,) = gathered(path).placed
    assert log.soundings[:, 0] == pytest.approx(ROWS[:, 0], abs=0.01)


def test_a_channel_of_a_lowrance_log_whose_positions_lag_does_not_mix_with_another(tmp_path):
    path = tmp_path / "a.log"
    data = bytearray(lowrance(ROWS))
    for at in range(8 + 164, len(data), 2 * 164):  # the side scan, 16 m north: jumps of 16 m within no time
        struct.pack_into("<i", data, at + 112, struct.unpack_from("<i", data, at + 112)[0] + 23)
    begin = len(data) - 164
    data += struct.pack("<I", len(data)) + data[begin + 4 :]  # the side scan has one more ping
    path.write_bytes(bytes(data))
    found = gathered(path, "--sounder", "channel primary")
    (log,) = found.placed
    assert "positions from channel primary;" in found.lines[0]
    assert len(log.soundings) == len(ROWS)
    assert not log.left_out["positions that jump"]
    assert log.soundings[:, 3] == pytest.approx(depth_m(*log.soundings[:, 1:3].T), abs=0.07)


def test_humminbirds_pings_are_read_from_the_folder_beside_it(tmp_path):
    path = tmp_path / "R00001.DAT"
    path.write_bytes(humminbird(ROWS, tmp_path))
    (log,) = gathered(path).placed
    assert len(log.soundings) == len(ROWS)
    # 12 cm: depths have decimetres, positions whole metres
    assert log.soundings[:, 3] == pytest.approx(depth_m(*log.soundings[:, 1:3].T), abs=0.12)
    (tmp_path / "R00001" / "B001.SON").unlink()
    with pytest.raises(LogError, match=r"without its pings\. Copy the folder"):
        gathered(path)


def test_two_sounders_of_one_boat_are_not_mixed(tmp_path):
    path = tmp_path / "a.bin"
    log = Dataflash()
    for i, (stamp, lat, lon, depth) in enumerate(ROWS):
        us = 5_000_000 + round(1e6 * (stamp - START_S))
        log.add("POS", us, round(lat * 1e7), round(lon * 1e7), 372.0, 0.0, 0.0)
        log.add("RFND", us, 0, round(100 * depth), 4, 25)
        log.add("RFND", us + 20_000, 1, 45 + i % 2, 4, 25)
    path.write_bytes(log.data)
    found = gathered(path)
    (placed,) = found.placed
    assert placed.soundings[:, 3] == pytest.approx(depth_m(*placed.soundings[:, 1:3].T), abs=0.02)
    assert '120 depths of RFND 1, 0.5 to 0.5 m (--sounder "RFND 1" takes them instead)' in found.lines[0]
    (other,) = gathered(path, "--sounder", "RFND 1").placed
    assert other.soundings[:, 3].max() < 1.0


def range_finder(rows, kind, name, out):
    """A log of a range finder's depths, and of the same without the range."""
    shown = np.column_stack([rows[:, :3], np.where(out, 51.0 + np.arange(len(rows)) % 7, rows[:, 3])])
    if kind == "tlog":
        return telemetry(shown, kinds=("GLOBAL_POSITION_INT", "DISTANCE_SENSOR", name))
    log = Dataflash()
    for (stamp, lat, lon, depth), is_out in zip(shown.tolist(), out.tolist(), strict=True):
        us = 5_000_000 + round(1e6 * (stamp - START_S))
        log.add("POS", us, round(lat * 1e7), round(lon * 1e7), 372.0, 0.0, 0.0)
        log.add("RFND", us, 0, round(100 * depth), 3 if is_out else 4, 25)
        log.add(name, us, 0, round(lat * 1e7), round(lon * 1e7), depth, 20.0)
    return log.data


@pytest.mark.parametrize(("kind", "name"), [("tlog", "RANGEFINDER"), ("bin", "DPTH")])
def test_depths_whose_range_another_message_shows_are_taken_only_if_asked_for(tmp_path, kind, name):
    """RANGEFINDER and DPTH repeat the range finder's depths also where there is no echo: they are more, and wrong."""
    path = tmp_path / f"a.{kind}"
    out = np.arange(len(ROWS)) % 4 == 0
    path.write_bytes(range_finder(ROWS, kind, name, out))
    found = gathered(path)
    (log,) = found.placed
    assert len(log.soundings) == 90
    assert log.soundings[:, 3] == pytest.approx(depth_m(*log.soundings[:, 1:3].T), abs=0.02)
    own = "RANGEFINDER" if kind == "tlog" else "DPTH 0"
    assert f'not used: 120 depths of {own}, 7.8 to 57.0 m (--sounder "{own}" takes them instead)' in found.lines[0]
    assert "- left out: 30 depths out of the range finder's range" in found.lines
    assert f"depths from {own};" in gathered(path, "--sounder", own).lines[0]
    path.write_bytes(range_finder(ROWS, kind, name, np.ones(len(ROWS), dtype=bool)))
    with pytest.raises(LogError, match=rf'120 depths of {own}.*Use {own} with --sounder "{own}"'):
        gathered(path)


@pytest.mark.parametrize("comma", [", ", ","])
def test_a_dataflash_log_that_a_ground_station_wrote_as_text_is_the_same(tmp_path, comma):
    from pymavlink.DFReader import DFReader_binary

    packed, text = tmp_path / "a.bin", tmp_path / "a.log"
    packed.write_bytes(dataflash(ROWS).data)
    reader, lines = DFReader_binary(str(packed)), []
    while (message := reader.recv_msg()) is not None:
        lines.append(
            comma.join([message.get_type(), *(str(getattr(message, name)) for name in message.get_fieldnames())])
        )
    text.write_text("\r\n".join([*lines, ""]))
    (found,), (expected,) = gathered(text).placed, gathered(packed).placed
    assert found.soundings == pytest.approx(expected.soundings, abs=1e-6)
    text.write_text("\r\n".join([*lines[:-30], "RFND, 5\udcff"]), errors="surrogateescape")
    with pytest.raises(FlightLogError, match=r"a\.log is a damaged dataflash log"):
        gathered(text)


def test_one_wrong_pressure_does_not_make_the_hull_s_barometer_the_water_s(tmp_path):
    log = dataflash(ROWS, "ArduSub V4.5.3", immersion_m=3.0)
    log.add("BARO", 65_500_000, 0, 0.0, 0.0)
    (tmp_path / "a.bin").write_bytes(log.data)
    found = gathered(tmp_path / "a.bin")
    assert "the vehicle's own depth from BARO 1" in found.lines[0]
    (placed,) = found.placed
    assert len(placed.soundings) == len(ROWS)
    assert placed.soundings[:, 3] == pytest.approx(depth_m(*placed.soundings[:, 1:3].T), abs=0.05)


def test_a_warm_hull_above_the_air_s_pressure_is_not_the_water(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(dataflash(ROWS, "ArduSub V4.5.3", immersion_m=3.0, hull_pa=109_000.0).data)
    found = gathered(path)
    assert "the vehicle's own depth from BARO 1" in found.lines[0]
    assert not [line for line in found.lines if "question: the lowest pressure" in line]


@pytest.mark.parametrize("dives_at", [0, 20])
def test_a_dive_that_is_logged_without_its_begin_has_no_pressure_of_the_surface(tmp_path, dives_at):
    """Its depths would be 3 m too small without a word."""
    path = tmp_path / "a.bin"
    path.write_bytes(dataflash(ROWS, "ArduSub V4.5.3", immersion_m=3.0, dives_at=dives_at).data)
    lines = gathered(path).lines
    assert "the vehicle's own depth from BARO 1" in lines[0]
    question = (
        "- question: the lowest pressure of BARO 1 is 1264 hPa, more than the air's. If the log begins and ends under "
        "water, all depths are too small by the vehicle's smallest depth in the log: import the whole dive, or add "
        "that depth to --draught"
    )
    assert (question in lines) == (dives_at == 0), lines


def test_components_of_a_vehicle_are_not_mixed(tmp_path):
    """A second sonar beside the autopilot's has the same number, and a companion its own positions."""
    path = tmp_path / "a.tlog"
    far = np.add(ROWS, [0.0, 0.01, 0.0, 0.0])
    far[:, 3] = np.linspace(2.0, 3.0, len(ROWS))
    path.write_bytes(
        in_turn(telemetry(ROWS), telemetry(far, kinds=("GLOBAL_POSITION_INT", "DISTANCE_SENSOR"), component=194))
    )
    found = gathered(path)
    (log,) = found.placed
    assert log.soundings[:, 3] == pytest.approx(depth_m(*log.soundings[:, 1:3].T), abs=0.02)
    other = "DISTANCE_SENSOR 0 of component 194"
    assert f'120 depths of {other}, 2.0 to 3.0 m (--sounder "{other}" takes them instead)' in found.lines[0]
    assert gathered(path, "--sounder", other).placed[0].soundings[:, 3].max() < 3.4


def in_turn(*logs):
    """Telemetry logs as one, in order of time."""
    messages = []
    for log in logs:
        at = 0
        while at < len(log):
            size = 8 + 12 + log[at + 9]
            messages.append(log[at : at + size])
            at += size
    return b"".join(sorted(messages, key=lambda message: message[:8]))


def pings(rows, quality):
    """A telemetry log whose sonar states a quality with each ping; at a low one its depth is wrong."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    mav, data = dialect.MAVLink(None, srcSystem=1, srcComponent=1), b""
    for i, (stamp, lat, lon, depth) in enumerate(rows):
        ms, good = round(1000 * (stamp - START_S)), quality(i)
        centimetres = round(100 * depth) if good in (0, 100) else 3900
        for message in (
            dialect.MAVLink_global_position_int_message(ms, round(lat * 1e7), round(lon * 1e7), 0, 0, 0, 0, 0, 0),
            dialect.MAVLink_distance_sensor_message(ms, 20, 5000, centimetres, 2, 1, 25, 0, signal_quality=good),
        ):
            data += struct.pack(">Q", round(stamp * 1e6)) + message.pack(mav)
    return data


def test_pings_of_low_quality_are_left_out(tmp_path):
    path = tmp_path / "a.tlog"
    path.write_bytes(pings(ROWS, lambda i: 100 if i % 3 else 9))
    found = gathered(path)
    (log,) = found.placed
    assert len(log.soundings) == 80
    assert log.soundings[:, 3] == pytest.approx(depth_m(*log.soundings[:, 1:3].T), abs=0.02)
    assert "- left out: 40 depths with a quality below 40 %" in found.lines
    path.write_bytes(pings(ROWS, lambda i: 0))  # this log states none
    assert len(gathered(path).placed[0].soundings) == 120
    path.write_bytes(pings(ROWS, lambda i: 9))
    with pytest.raises(LogError, match="all 120 depths of DISTANCE_SENSOR 1 have a quality below 40 %"):
        gathered(path)


def in_units(name, rows, factor, unit):
    """A GPX or GeoJSON log whose depths are in a unit that it states."""
    text = LOGS[name](rows * [1.0, 1.0, 1.0, factor]).decode()
    text = text.replace("<gpxtpx:depth>", f'<gpxtpx:depth unit="{unit}">')
    return text.replace('"depth":', f'"units": "{unit}", "depth":').encode()


@pytest.mark.parametrize("name", ["a.gpx", "a.geojson"])
def test_two_files_joined_into_one_are_refused(tmp_path, name):
    """Only the first was read."""
    path = tmp_path / name
    path.write_bytes(LOGS[name](ROWS[:60]) + b"\n" + LOGS[name](ROWS[60:]))
    with pytest.raises(LogError, match=rf"{name} holds 2 (GPX files|collections)\. Split it into one file each\."):
        gathered(path)


@pytest.mark.parametrize("name", ["a.gpx", "a.geojson"])
def test_the_unit_that_a_log_states_beside_its_depths_counts(tmp_path, name):
    feet, metres = tmp_path / f"feet{name[1:]}", tmp_path / name
    feet.write_bytes(in_units(name, ROWS, 1.0 / 0.3048, "ft"))
    metres.write_bytes(LOGS[name](ROWS))
    (found,), (expected,) = gathered(feet).placed, gathered(metres).placed
    assert found.soundings[:, 3] == pytest.approx(expected.soundings[:, 3], abs=1e-3)
    assert "depths in ft, 0.3048 m" in "\n".join(gathered(feet).lines)


def test_depths_in_the_extensions_of_a_humminbird_are_centimetres(tmp_path):
    own, metres = tmp_path / "own.gpx", tmp_path / "a.gpx"
    text = gpx(ROWS * [1.0, 1.0, 1.0, 100.0]).decode().replace("gpxtpx:depth", "h:depth")
    own.write_text(text.replace("<gpx ", '<gpx xmlns:h="http://www.humminbird.com" '))
    metres.write_bytes(gpx(ROWS))
    (found,), (expected,) = gathered(own).placed, gathered(metres).placed
    assert found.soundings[:, 3] == pytest.approx(expected.soundings[:, 3], abs=1e-3)
    own.write_text(own.read_text().replace("<h:depth>", '<h:depth units="mm">'))
    draught_m, (found,) = 0.3, gathered(own).placed
    assert found.soundings[:, 3] - draught_m == pytest.approx(0.1 * (expected.soundings[:, 3] - draught_m), abs=1e-3)


@pytest.mark.parametrize("name", ["a.gpx", "a.geojson"])
def test_negative_depths_are_metres_down(tmp_path, name):
    negative, metres = tmp_path / f"negative{name[1:]}", tmp_path / name
    negative.write_bytes(LOGS[name](ROWS * [1.0, 1.0, 1.0, -1.0]))
    metres.write_bytes(LOGS[name](ROWS))
    (found,), (expected,) = gathered(negative).placed, gathered(metres).placed
    assert found.soundings[:, 3] == pytest.approx(expected.soundings[:, 3], abs=1e-3)
    assert "negative depths are taken as metres down" in "\n".join(gathered(negative).lines)


@pytest.mark.parametrize("name", ["a.gpx", "a.geojson"])
def test_depths_in_an_unknown_unit_are_refused(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(in_units(name, ROWS, 1.0, "cubits"))
    with pytest.raises(LogError, match=r"120 (depths in a unit that is not|points without a depth in a known unit)"):
        gathered(path)


@pytest.mark.parametrize("name", ["a.sl2", "a.sl3", "a.wibl", "a.gpx", "a.geojson"])
def test_a_log_that_is_cut_off_is_read_up_to_its_end(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(LOGS[name](ROWS)[: -len(LOGS[name](ROWS)) // 3])
    (log,) = gathered(path).placed
    assert 60 < len(log.soundings) < 100


def test_every_depth_and_position_is_a_sounding_or_counted(tmp_path):
    """Fast pings, positions without an answer, times that stand still, and damaged numbers."""
    log, rng = Dataflash(), np.random.default_rng(3)
    fast = np.repeat(ROWS, 5, axis=0)
    fast[:, 0] += np.tile(np.arange(5) * 0.2, len(ROWS))
    log.add("MSG", 0, b"ArduRover V4.5.7")
    for stamp, lat, lon, depth in fast:
        us = 5_000_000 + round(1e6 * (stamp - START_S))
        week, of_week = divmod(stamp - 315_964_800 + 18, 604_800)
        fix = 4 if rng.random() > 0.1 else 1
        for _ in range(2):
            log.add("GPS", us, 0, fix, round(of_week * 1000), int(week), 12, 90, round(lat * 1e7), round(lon * 1e7),
                    37200, 2.0, 0.0, 0.0, 0.0, 1)  # fmt: skip
        log.add("RFND", us, 0, round(100 * depth), 4 if rng.random() > 0.1 else 2, 25)
    (tmp_path / "a.bin").write_bytes(log.data)
    found = gathered(tmp_path / "a.bin")
    (placed,) = found.placed
    counts = placed.left_out
    depths = sum(count for reason, count in counts.items() if reason.startswith("depths"))
    assert placed.combined + depths == len(fast), counts
    positions = sum(count for reason, count in counts.items() if reason.startswith("positions"))
    assert 0.5 * len(fast) < positions < 2 * len(fast)
    assert counts["positions at the time of the one before, or earlier"] > 0.8 * len(fast)
    assert len(placed.soundings) + counts["soundings: jump"] == len(ROWS)
    assert f"- pings of each second are one sounding: {placed.combined} pings" in found.lines


@pytest.mark.parametrize(("wrong", "kept"), [([0], 119), ([0, 1], 118), (range(0, 120, 4), 90)])
def test_a_wrong_depth_at_the_start_is_left_out_and_not_those_after_it(tmp_path, wrong, kept):
    """The gate compares with the last sounding that passed: it kept the first one, and rejected true ones after it."""
    rows, path = ROWS.copy(), tmp_path / "a.tlog"
    rows[wrong, 3] = 30.0 + np.arange(len(wrong)) % 7
    path.write_bytes(telemetry(rows))
    (log,) = gathered(path).placed
    assert len(log.soundings) == kept
    assert log.soundings[:, 3] == pytest.approx(depth_m(*log.soundings[:, 1:3].T), abs=0.02)
    assert log.left_out["soundings: jump"] == 120 - kept


@pytest.mark.parametrize("name", ["a.nmea", "a.bin", "a.tlog", "a.sl2"])
def test_a_depth_that_a_sounder_shows_without_an_echo_is_left_out(tmp_path, name):
    rows = survey()
    rows[5::20, 3] = 45.0  # within the range of the range finders
    logs = {"a.nmea": lambda own: nmea(own).encode(), "a.bin": lambda own: dataflash(own).data, "a.tlog": telemetry}
    path = tmp_path / name
    path.write_bytes((logs | LOGS)[name](rows))
    found = gathered(path)
    assert f"- left out: {len(rows[5::20])} depths of 45 m, repeated and far from all others" in found.lines
    assert found.placed[0].soundings[:, 3].max() < 17.0


@pytest.mark.parametrize("separators", [(", ", ": "), (",", ":")])
@pytest.mark.parametrize(
    ("reference", "steps", "asked"),
    [
        ("Transducer", [], "question: depths are below the transducer, whose depth is unknown"),
        ("Unknown", [], "question: the file does not state what its depths are measured from: the surface is assumed"),
        ("Unknown", ["LN02 372 m"], "; depths are reduced to LN02 372 m: auv_lse export --datum 'LN02 372 m' keeps it"),
        ("Waterline", [], ""),
    ],
)
def test_the_vertical_reference_of_crowdsourced_bathymetry_is_asked_about(
    tmp_path, separators, reference, steps, asked
):
    data = json.loads(crowdsourced(survey()[:120]))
    data["properties"]["trustedNode"] = {"verticalReferenceOfDepth": reference}
    data["properties"]["processing"] = [{"type": "VerticalReduction", "datum": datum} for datum in steps]
    (tmp_path / "a.geojson").write_text(json.dumps(data, separators=separators))
    options = parser().parse_args([str(tmp_path / "a.geojson"), "--origin", "46.5", "6.6"])
    lines = gather(options.logs, user_facts(options)).lines
    questions = [line for line in lines if "question" in line]
    assert len(questions) == ("question" in asked)
    assert any(asked in line for line in lines)


def test_a_damaged_name_of_a_datum_is_an_unnamed_datum(tmp_path):
    data = json.loads(crowdsourced(survey()[:120]))
    data["properties"]["processing"] = [{"type": "VerticalReduction", "datum": "LN02"}]
    (tmp_path / "a.geojson").write_text(json.dumps(data).replace("LN02", r"L\q"))
    options = parser().parse_args([str(tmp_path / "a.geojson"), "--origin", "46.5", "6.6"])
    assert any("reduced to an unnamed datum" in line for line in gather(options.logs, user_facts(options)).lines)
