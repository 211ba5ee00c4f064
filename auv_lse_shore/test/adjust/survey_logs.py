"""Logs of one survey over a known bottom, as boats write them: the tests' logs."""

import struct

import numpy as np

from auv_lse_common.vocabulary.frames import geodetic_from_local

ORIGIN = (46.5, 6.6)
#: 2026-05-03 10:00:00 UTC.
START_S = 1_777_802_400.0
#: The range finder is this far below the surface (m).
DRAUGHT_M = 0.3


def depth_m(north, east):
    """The bottom: a slope with a hump."""
    hump = 3.0 * np.exp(-((np.asarray(north) - 60.0) ** 2 + (np.asarray(east) - 80.0) ** 2) / 900.0)
    return 8.0 + 0.05 * np.asarray(east) - hump


def lanes(lanes=7, length_m=160.0, apart_m=20.0, step_m=2.0):
    """Positions (n, 2) along lanes, 2 m and 1 s apart."""
    rows = []
    for lane in range(lanes):
        east = np.arange(0.0, length_m + 0.1, step_m)
        rows += [(lane * apart_m, e) for e in (east if lane % 2 == 0 else east[::-1])]
        rows += [(lane * apart_m + d, rows[-1][1]) for d in np.arange(step_m, apart_m, step_m)]
    return np.array(rows)


def survey():
    """Rows: time (s), latitude, longitude (deg), depth below the range finder (m)."""
    positions = lanes()
    lat, lon = geodetic_from_local(positions[:, 0], positions[:, 1], *ORIGIN)
    return np.column_stack([START_S + np.arange(len(positions)), lat, lon, depth_m(*positions.T) - DRAUGHT_M])


def sentence(body):
    """An NMEA sentence with its checksum."""
    total = 0
    for byte in body.encode():
        total ^= byte
    return f"${body}*{total:02X}\r\n"


def _angle(value, digits, sides):
    whole, minutes = divmod(abs(value) * 60.0, 60.0)
    return f"{int(whole):0{digits}d}{minutes:08.5f},{sides[int(value < 0)]}"


def nmea(rows, start_s=START_S - START_S % 86400):
    """GGA, RMC and DBT of each row."""
    lines = []
    for stamp, lat, lon, depth in rows:
        of_day = (stamp - start_s) % 86400
        clock = f"{int(of_day // 3600):02d}{int(of_day % 3600 // 60):02d}{of_day % 60:05.2f}"
        position = f"{_angle(lat, 2, 'NS')},{_angle(lon, 3, 'EW')}"
        lines.append(sentence(f"GPRMC,{clock},A,{position},3.9,90.0,030526,,,A"))
        lines.append(sentence(f"GPGGA,{clock},{position},2,09,0.9,372.0,M,48.0,M,,"))
        lines.append(sentence(f"SDDBT,{depth / 0.3048:.2f},f,{depth:.2f},M,{depth / 1.8288:.2f},F"))
    return "".join(lines)


#: The dataflash messages of the tests: type, name, format, columns.
_FORMATS = {
    "GPS": (130, "QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U"),
    "POS": (131, "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt"),
    "RFND": (132, "QBCBB", "TimeUS,Instance,Dist,Stat,Orient"),
    "BARO": (133, "QBff", "TimeUS,I,Alt,Press"),
    "MSG": (134, "QZ", "TimeUS,Message"),
    "DPTH": (135, "QBLLff", "TimeUS,Inst,Lat,Lng,Depth,Temp"),
}
#: RFND before ArduPilot 4.1.
_OLD_RFND = (132, "QCBCB", "TimeUS,Dist1,Orient1,Dist2,Orient2")
_CODES = {"Q": "Q", "B": "B", "I": "I", "H": "H", "c": "h", "L": "i", "e": "i", "f": "f", "C": "H", "Z": "64s"}


class Dataflash:
    """Writes an ArduPilot dataflash log."""

    def __init__(self, old=False):
        self.data = b""
        self._formats = _FORMATS | ({"RFND": _OLD_RFND} if old else {})
        self._define(0x80, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
        for name, (number, codes, columns) in self._formats.items():
            size = 3 + struct.calcsize("<" + "".join(_CODES[c] for c in codes))
            self._define(number, size, name, codes, columns)

    def _define(self, number, size, *texts):
        self.data += b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, size, *(text.encode() for text in texts))

    def add(self, name, *values):
        number, codes, _ = self._formats[name]
        self.data += b"\xa3\x95" + bytes([number]) + struct.pack("<" + "".join(_CODES[c] for c in codes), *values)


def dataflash(rows, vehicle="ArduRover V4.5.7", immersion_m=0.0, dives_at=20, hull_pa=97_000.0):
    """GPS, POS and RFND of each row; a submarine dives to `immersion_m` in a row, and also logs pressures."""
    log = Dataflash()
    log.add("MSG", 0, vehicle.encode())
    for i, (stamp, lat, lon, depth) in enumerate(rows):
        us = 5_000_000 + round(1e6 * (stamp - START_S))
        week, of_week = divmod(stamp - 315_964_800 + 18, 604_800)
        sunk = immersion_m if i >= dives_at else 0.0
        lat_e7, lon_e7 = round(lat * 1e7), round(lon * 1e7)
        log.add("GPS", us, 0, 4, round(of_week * 1000), int(week), 12, 90, lat_e7, lon_e7, 37200, 2.0, 0.0, 0.0, 0.0, 1)
        log.add("BARO", us, 0, 0.0, hull_pa + i % 3)
        log.add("BARO", us, 1, 0.0, 97_000.0 + sunk * 998.0 * 9.8075)
        log.add("POS", us, lat_e7, lon_e7, 372.0, -sunk, 0.0)
        log.add("RFND", us, 0, round(100 * (depth - sunk)), 4, 25)
    return log


def telemetry(rows, system=1, kinds=("HEARTBEAT", "GLOBAL_POSITION_INT", "DISTANCE_SENSOR"), component=1):
    """HEARTBEAT, GLOBAL_POSITION_INT and DISTANCE_SENSOR of each row, or others, from a component of a vehicle."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
    data = b""
    for stamp, lat, lon, depth in rows:
        ms = round(1000 * (stamp - START_S))
        for message in (
            dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3),
            dialect.MAVLink_global_position_int_message(ms, round(lat * 1e7), round(lon * 1e7), 0, 0, 0, 0, 0, 0),
            dialect.MAVLink_distance_sensor_message(ms, 20, 5000, round(100 * depth), 0, 0, 25, 0),
            dialect.MAVLink_rangefinder_message(depth, 0.0),
        ):
            if message.get_type() in kinds:
                data += struct.pack(">Q", round(stamp * 1e6)) + message.pack(mav)
    return data
