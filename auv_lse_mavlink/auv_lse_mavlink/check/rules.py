"""The parameters that a mission depends on, by firmware: what each value does, and which one to set.

Names are those of ArduPilot 4.1 to 4.7, then of 4.8, which renamed some and changed their units. A failsafe is judged
by what the vehicle does: one that disarms it is a fault, since it drifts or sinks.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from auv_lse_mavlink.messages.wire import mavlink

#: Rate (Hz) that message streams are set to, and the lowest that suffices.
STREAM_HZ, LEAST_STREAM_HZ = 4.0, 2.0
#: A range finder's greatest distance is set to this share of the mission's depth: the water is deeper in places.
BEYOND = 1.5
#: Density of the water that the autopilot and the link assume may differ by this share.
SAME_DENSITY = 0.005
#: Messages by the group of ArduPilot's streams (SRn_..., MAVn_... since 4.8) that contains them.
STREAMS = {
    "POSITION": ("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT"),
    "EXTRA1": ("ATTITUDE",),
    "EXTRA3": ("DISTANCE_SENSOR", "SYSTEM_TIME"),
    "RAW_SENS": ("SCALED_PRESSURE", "SCALED_PRESSURE2", "SCALED_PRESSURE3"),
    "EXT_STAT": ("SYS_STATUS", "GPS_RAW_INT", "MISSION_CURRENT", "NAV_CONTROLLER_OUTPUT"),
}
#: The vehicle's reaction to a lost ground station or an alarm, by value; and whether that is safe.
_SUB_GCS = {
    0.0: (False, "the vehicle goes on to its target and stays there under water"),
    1.0: (False, "the vehicle only reports it, goes on to its target and stays there under water"),
    2.0: (False, "the vehicle disarms and drifts"),
    3.0: (None, "the vehicle holds its depth and stays under water"),
    4.0: (True, "the vehicle surfaces"),
}
_SUB_PILOT = {
    0.0: (True, "a joystick that stops does nothing"),
    1.0: (True, "a joystick that stops is reported"),
    2.0: (False, "the vehicle disarms 3 s after a joystick stops, or without one"),
}
_SUB_LEAK = {
    0.0: (False, "a leak is not reported"),
    1.0: (True, "a leak is reported; the mission aborts"),
    2.0: (True, "the vehicle surfaces"),
}
_ROVER_GCS = {
    0.0: (False, "the vehicle goes on to its target"),
    1.0: (True, "it carries out FS_ACTION"),
    2.0: (None, "it carries out FS_ACTION, but continues in AUTO"),
}
_ROVER_ACTION = {
    0.0: (False, "the vehicle goes on to its target"),
    1.0: (None, "the vehicle returns home in a straight line"),
    2.0: (True, "the vehicle stops"),
    3.0: (None, "the vehicle returns home"),
    4.0: (None, "the vehicle returns home, or stops"),
    5.0: (False, "the vehicle disarms and drifts"),
    6.0: (True, "the vehicle holds its position"),
}
_ROVER_THROTTLE = {
    0.0: (True, "no radio is expected"),
    1.0: (False, "without a radio the vehicle carries out FS_ACTION"),
    2.0: (None, "without a radio the vehicle carries out FS_ACTION, but continues in AUTO"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """The setup that parameters must fit.

    Attributes:
        kind: MAV_AUTOPILOT and MAV_TYPE of the autopilot.
        own_id: MAVLink system id of this stack.
        density_kgpm3: Density of the water (`link.water_density_kgpm3`).
        depth_m: Greatest water depth to be sounded (m); NaN: unknown.
        has_gps: Whether GPS has had a fix; None: unknown.
        port: Number n of the autopilot's port in SRn_....
        rates_hz: Messages that arrive, and how often (1/s).
    """

    kind: tuple[int, int]
    own_id: int
    density_kgpm3: float = 1000.0
    depth_m: float = math.nan
    has_gps: bool | None = None
    port: int = 0
    rates_hz: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Judgement:
    """Whether a value is right (None: usable), what it does, and the value to set (None: leave it)."""

    ok: bool | None
    text: str
    wanted: float | None = None


@dataclass(frozen=True, slots=True)
class Rule:
    """A parameter: its names, each with its unit as a share of the first name's, and the judgement of a value.

    Values are judged in the first name's unit. `reboots`: a change takes effect at the next boot.
    """

    names: tuple[tuple[str, float], ...]
    judge: Callable[[float], Judgement]
    reboots: bool = False


def rules(setting: Setting) -> tuple[Rule, ...]:
    """The parameters to ask an autopilot for."""
    autopilot, vehicle = setting.kind
    if autopilot == mavlink.MAV_AUTOPILOT_PX4:
        return tuple(_px4())
    if autopilot != mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        return ()
    firmware = _sub(setting) if vehicle == mavlink.MAV_TYPE_SUBMARINE else _rover()
    return (*firmware, *_range_finder(setting), *_common(setting), *_streams(setting))


def after_silence(setting: Setting, values: Mapping[str, float]) -> str:
    """An ArduPilot's reaction when this stack's heartbeats stop, by its parameters; "" if that is unknown."""
    value = values.get("FS_GCS_ENABLE")
    if value is None or setting.kind[0] != mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        return ""
    if setting.kind[1] == mavlink.MAV_TYPE_SUBMARINE:
        return _SUB_GCS.get(value, (None, ""))[1]
    if value == 0.0:
        return _ROVER_GCS[0.0][1]
    return _ROVER_ACTION.get(values.get("FS_ACTION", math.nan), (None, ""))[1]


def _choice(table: Mapping[float, tuple[bool | None, str]], wanted: float) -> Callable[[float], Judgement]:
    def judge(value: float) -> Judgement:
        ok, text = table.get(value, (None, "unknown value"))
        return Judgement(ok, text, wanted if ok is False else None)

    return judge


def _known(text: str) -> Callable[[float], Judgement]:
    return lambda value: Judgement(True, text)


def _equal(wanted: float, text: str) -> Callable[[float], Judgement]:
    return lambda value: Judgement(value == wanted, text, None if value == wanted else wanted)


def _sub(setting: Setting) -> Iterator[Rule]:
    yield Rule((("FS_GCS_ENABLE", 1.0),), _choice(_SUB_GCS, 4.0))
    yield Rule((("FS_PILOT_INPUT", 1.0),), _choice(_SUB_PILOT, 1.0))
    yield Rule((("FS_LEAK_ENABLE", 1.0),), _choice(_SUB_LEAK, 2.0))
    yield Rule((("BARO_PRIMARY", 1.0),), _known("the barometer that it zeroes: must be the one in the water"))
    density = setting.density_kgpm3 / 1000.0

    def judge_density(value: float) -> Judgement:
        same = abs(value - density) <= SAME_DENSITY * density
        return Judgement(same, "density for its own depth: link.water_density_kgpm3", None if same else density)

    yield Rule((("BARO_SPEC_GRAV", 1.0),), judge_density)
    yield Rule((("WPNAV_SPEED", 1.0), ("WP_SPD", 0.01)), _known("cm/s on a leg without a speed of its own"))
    if setting.has_gps is False:
        text = "without GPS: position and velocity of a DVL or USBL (6)"
        yield Rule((("VISO_TYPE", 1.0),), _equal(1.0, "takes a DVL's or USBL's position over MAVLink"), reboots=True)
        yield Rule((("EK3_SRC1_POSXY", 1.0),), _equal(6.0, text))
        yield Rule((("EK3_SRC1_VELXY", 1.0),), _equal(6.0, text))


def _rover() -> Iterator[Rule]:
    yield Rule((("FS_GCS_ENABLE", 1.0),), _choice(_ROVER_GCS, 1.0))
    yield Rule((("FS_ACTION", 1.0),), _choice(_ROVER_ACTION, 2.0))
    yield Rule((("FS_THR_ENABLE", 1.0),), _choice(_ROVER_THROTTLE, 0.0))
    yield Rule((("WP_SPEED", 1.0), ("WP_SPD", 1.0)), _known("m/s on a leg without a speed of its own"))


def _range_finder(setting: Setting) -> Iterator[Rule]:
    mavlink_type = 10.0

    def judge_type(value: float) -> Judgement:
        text = "0: no range finder; 10: distances over MAVLink"
        return Judgement(value != 0.0, text, mavlink_type if value == 0.0 else None)

    def judge_reach(value: float) -> Judgement:
        if math.isnan(setting.depth_m):
            return Judgement(
                None, f"cm: no soundings more than {value / 100.0:g} m below the vehicle (--depth checks it)"
            )
        wanted = math.ceil(BEYOND * setting.depth_m) * 100.0
        enough = value >= 100.0 * setting.depth_m
        text = f"cm: the mission's water is {setting.depth_m:g} m deep, and beyond this there are no soundings"
        return Judgement(enough, text, None if enough else wanted)

    yield Rule((("RNGFND1_TYPE", 1.0),), judge_type, reboots=True)
    yield Rule((("RNGFND1_ORIENT", 1.0),), _equal(25.0, "the range finder looks down"))
    yield Rule((("RNGFND1_MAX_CM", 1.0), ("RNGFND1_MAX", 0.01)), judge_reach)


def _common(setting: Setting) -> Iterator[Rule]:
    text = "FS_GCS_ENABLE watches this system: link.system_id"
    yield Rule((("SYSID_MYGCS", 1.0), ("MAV_GCS_SYSID", 1.0)), _equal(float(setting.own_id), text))
    yield Rule((("SYSID_THISMAV", 1.0), ("MAV_SYSID", 1.0)), _known("its system id: link.autopilot_system_id"))


def _streams(setting: Setting) -> Iterator[Rule]:
    for group, messages in STREAMS.items():
        arrive = all(setting.rates_hz.get(name, 0.0) >= 0.5 * LEAST_STREAM_HZ for name in messages[:1])
        text = f"Hz: {', '.join(messages)}"

        def judge(value: float, arrive: bool = arrive, text: str = text) -> Judgement:
            if value >= LEAST_STREAM_HZ:
                return Judgement(True, text)
            return Judgement(None if arrive else False, text, None if arrive else STREAM_HZ)

        names = (f"SR{setting.port}_{group}", 1.0), (f"MAV{setting.port + 1}_{group}", 1.0)
        yield Rule(names, judge, reboots=True)


def _px4() -> Iterator[Rule]:
    yield Rule((("COM_OF_LOSS_T", 1.0),), _known("s after the last setpoint until Offboard ends"))
    yield Rule((("COM_RC_IN_MODE", 1.0),), _equal(4.0, "no radio is expected"))
    yield Rule((("NAV_DLL_ACT", 1.0),), _known("what it does when the link is lost"))
