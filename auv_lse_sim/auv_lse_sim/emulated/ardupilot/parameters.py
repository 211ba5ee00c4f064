"""Parameters of a simulated ArduPilot, under the names of its firmware.

The autopilot uses the names of 4.5. Firmware 4.8 has other names, and other units, for some of them (`RENAMED`).
"""

from collections.abc import Mapping
from dataclasses import dataclass

from auv_lse_mavlink.messages.wire import mavlink

_INT8, _INT16, _INT32 = (
    mavlink.MAV_PARAM_TYPE_INT8,
    mavlink.MAV_PARAM_TYPE_INT16,
    mavlink.MAV_PARAM_TYPE_INT32,
)
_REAL = mavlink.MAV_PARAM_TYPE_REAL32

#: Groups of streamed messages, each with a rate (Hz) in a parameter SR0_....
STREAMS = ("RAW_SENS", "EXT_STAT", "RC_CHAN", "POSITION", "EXTRA1", "EXTRA2", "EXTRA3", "PARAMS")

#: Values after the first boot, with their types.
_COMMON: dict[str, tuple[float, int]] = {
    "SYSID_THISMAV": (1.0, _INT16),
    "SYSID_MYGCS": (255.0, _INT16),
    "RNGFND1_TYPE": (0.0, _INT8),
    "RNGFND1_ORIENT": (25.0, _INT8),
    "RNGFND1_MIN_CM": (20.0, _INT16),
    "RNGFND1_MAX_CM": (700.0, _INT16),
    "BARO_PRIMARY": (0.0, _INT8),
    "STAT_RUNTIME": (0.0, _INT32),
    "BARO1_GND_PRESS": (101325.0, _REAL),
    "MIS_TOTAL": (0.0, _INT16),
    **{f"SR0_{group}": (0.0, _INT16) for group in STREAMS},
}
SUB_DEFAULTS: dict[str, tuple[float, int]] = _COMMON | {
    "FS_GCS_ENABLE": (2.0, _INT8),
    "FS_PILOT_INPUT": (2.0, _INT8),
    "FS_PILOT_TIMEOUT": (3.0, _REAL),
    "FS_LEAK_ENABLE": (1.0, _INT8),
    "BARO_SPEC_GRAV": (1.0, _REAL),
    "WPNAV_SPEED": (100.0, _REAL),
}
ROVER_DEFAULTS: dict[str, tuple[float, int]] = _COMMON | {
    "FS_GCS_ENABLE": (0.0, _INT8),
    "FS_THR_ENABLE": (1.0, _INT8),
    "WP_SPEED": (2.0, _REAL),
    "CRUISE_SPEED": (2.0, _REAL),
}

#: Parameters that take effect at the next boot.
NEEDS_REBOOT = frozenset({"RNGFND1_TYPE", "SYSID_THISMAV", *(f"SR0_{group}" for group in STREAMS)})

#: Name in 4.8-dev by name in 4.5, and its unit as a share of the older one's.
RENAMED: dict[str, tuple[str, float]] = {
    "SYSID_MYGCS": ("MAV_GCS_SYSID", 1.0),
    "SYSID_THISMAV": ("MAV_SYSID", 1.0),
    "RNGFND1_MIN_CM": ("RNGFND1_MIN", 0.01),
    "RNGFND1_MAX_CM": ("RNGFND1_MAX", 0.01),
    "WPNAV_SPEED": ("WP_SPD", 0.01),
    "WP_SPEED": ("WP_SPD", 1.0),
    **{f"SR0_{group}": (f"MAV1_{group}", 1.0) for group in STREAMS},
}


@dataclass(frozen=True, slots=True)
class WireValue:
    """A parameter as it is sent: name, value, MAV_PARAM_TYPE and index."""

    name: str
    value: float
    kind: int
    index: int


class Parameters:
    """The parameters of one autopilot; own code reads them by the names of 4.5."""

    def __init__(self, defaults: Mapping[str, tuple[float, int]], renamed: bool = False) -> None:
        """Starts with `defaults` (value and type by name of 4.5); `renamed`: the firmware has the names of 4.8."""
        self._values = {name: value for name, (value, _) in defaults.items()}
        self._kinds = {name: kind for name, (_, kind) in defaults.items()}
        self._wire = {name: RENAMED.get(name, (name, 1.0)) if renamed else (name, 1.0) for name in defaults}
        self._own = {wire: name for name, (wire, _) in self._wire.items()}
        self._at_boot = dict(self._values)

    def __len__(self) -> int:
        """The number of parameters."""
        return len(self._values)

    def __getitem__(self, name: str) -> float:
        """The value in force, by the name of 4.5."""
        return self._at_boot[name] if name in NEEDS_REBOOT else self._values[name]

    def put(self, **values: float) -> None:
        """Changes values by the names of 4.5."""
        self._values |= values

    def boot(self) -> None:
        """Brings every value into force."""
        self._at_boot = dict(self._values)

    def on_wire(self, name: str) -> WireValue | None:
        """A parameter by its name on the wire; None: there is no such parameter."""
        own = self._own.get(name)
        if own is None:
            return None
        kind = self._kinds[own] if self._wire[own][1] == 1.0 else _REAL
        return WireValue(name, self._values[own] * self._wire[own][1], kind, list(self._own).index(name))

    def change(self, name: str, value: float) -> WireValue | None:
        """Changes a parameter by its name on the wire; None: there is no such parameter."""
        own = self._own.get(name)
        if own is not None:
            self._values[own] = value / self._wire[own][1]
        return self.on_wire(name)

    @property
    def names(self) -> tuple[str, ...]:
        """Names on the wire, in the order of their indices."""
        return tuple(self._own)
