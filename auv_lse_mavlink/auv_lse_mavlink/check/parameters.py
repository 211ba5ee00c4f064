"""Reads an autopilot's parameters, proposes changes, sets them and verifies them."""

import dataclasses
import math
import struct
from collections.abc import Callable

from auv_lse_common.support.device_findings import Finding
from auv_lse_mavlink.check.rules import Rule
from auv_lse_mavlink.messages.wire import Message, mavlink

#: A set value counts as set within this share: it is a float32 on the wire.
ROUNDING = 1e-5
#: Number of times that a change is sent.
TRIES = 5


@dataclasses.dataclass(frozen=True, slots=True)
class Change:
    """A proposed change: name and values in the firmware's own unit, the reason, whether it needs a reboot."""

    name: str
    before: float
    after: float
    why: str
    reboots: bool


class ParameterReader:
    """One autopilot's parameters.

    Attributes:
        values: Values by name, as the firmware has them.
    """

    def __init__(self, send: Callable[[Message], None], system: int, component: int) -> None:
        """Sends with `send` to the autopilot `system`, `component`."""
        self.values: dict[str, float] = {}
        self._kinds: dict[str, int] = {}
        self._send, self._to = send, (system, component)
        self._wanted: dict[str, Change] = {}
        self._tries = 0
        self._is_px4 = False

    def take(self, message: Message, is_px4: bool) -> None:
        """Handles a PARAM_VALUE."""
        self._is_px4 = is_px4
        self.values[message.param_id] = _decode(message, is_px4)
        self._kinds[message.param_id] = message.param_type

    def ask(self, rules: tuple[Rule, ...]) -> None:
        """Requests each parameter that is unknown under all of its names."""
        for rule in rules:
            if not any(name in self.values for name, _ in rule.names):
                for name, _ in rule.names:
                    self._send(mavlink.MAVLink_param_request_read_message(*self._to, name.encode(), -1))

    def judge(self, rules: tuple[Rule, ...]) -> tuple[list[Finding], list[Change]]:
        """Findings about the parameters, and the changes to make."""
        findings, changes = [], []
        for rule in rules:
            known = [(name, unit) for name, unit in rule.names if name in self.values]
            if not known:
                names = " or ".join(name for name, _ in rule.names)
                findings.append(Finding(ok=None, text=f"{names}: no answer"))
                continue
            name, unit = known[0]
            value = self.values[name]
            judged = rule.judge(value / unit)
            text = f"{name} = {value:g} ({judged.text})"
            if judged.wanted is not None:
                after = judged.wanted * unit
                changes.append(Change(name, value, after, judged.text, rule.reboots))
                text = f"{name} = {value:g}; set {after:g} ({judged.text})"
            findings.append(Finding(ok=judged.ok, text=text))
        return findings, changes

    def apply(self, changes: list[Change]) -> None:
        """Begins to set parameters."""
        self._wanted = {change.name: change for change in changes}
        self._tries = 0

    @property
    def is_applying(self) -> bool:
        """Whether a change is neither verified nor abandoned."""
        return any(not self._is_set(change) for change in self._wanted.values()) and self._tries <= TRIES

    def step(self) -> None:
        """Sends the changes that are not verified yet; call it once or twice a second."""
        self._tries += 1
        for change in self._wanted.values():
            if not self._is_set(change) and self._tries <= TRIES:
                kind = self._kinds[change.name]
                value = _encode(change.after, kind, self._is_px4)
                self._send(mavlink.MAVLink_param_set_message(*self._to, change.name.encode(), value, kind))

    def applied(self) -> list[Finding]:
        """Findings about the changes: which were set, and which were not."""
        found = []
        for change in self._wanted.values():
            done = self._is_set(change)
            text = f"{change.name}: {change.before:g} -> {change.after:g}"
            if not done:
                text += f"; it still is {self.values[change.name]:g}. Set it in a ground station"
            found.append(Finding(ok=done, text=f"set {text}" if done else f"not set: {text}"))
        late = [change.name for change in self._wanted.values() if change.reboots and self._is_set(change)]
        if late:
            found.append(Finding(ok=None, text=f"reboot the autopilot: {', '.join(late)} take effect then"))
        return found

    def _is_set(self, change: Change) -> bool:
        value = self.values.get(change.name, math.nan)
        return math.isclose(value, change.after, rel_tol=ROUNDING, abs_tol=ROUNDING)


def _decode(message: Message, is_px4: bool) -> float:
    """The value of a PARAM_VALUE; PX4 stores an integer's bytes in the float."""
    if is_px4 and message.param_type == mavlink.MAV_PARAM_TYPE_INT32:
        return float(int.from_bytes(struct.pack("<f", message.param_value), "little", signed=True))
    return float(message.param_value)


def _encode(value: float, kind: int, is_px4: bool) -> float:
    if is_px4 and kind == mavlink.MAV_PARAM_TYPE_INT32:
        return float(struct.unpack("<f", round(value).to_bytes(4, "little", signed=True))[0])
    return value
