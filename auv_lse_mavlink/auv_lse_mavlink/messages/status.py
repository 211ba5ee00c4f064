"""The state that an autopilot reports: mode, arming, battery, leak, and texts for the operator."""

import math

from auv_lse_mavlink.messages.wire import Message, mavlink

#: ArduSub reports a leak by text only, every 20 s while it lasts: after this time (s) without one it is over. The
#: safety watch keeps the limit tripped until RESET.
LEAK_REPORTED_S = 50.0
#: A charge that was reported this long ago (s) is unknown.
CHARGE_S = 5.0
#: MAVLink counts energy in hJ.
HJ_PER_WH = 36.0
#: Texts that ArduPilot sends as warnings in normal operation: after each upload while it flies a mission.
ROUTINE_TEXTS = ("Auto mission changed, restarted command",)
#: Time (s) after which a repeated warning is reported again, and number of warnings that are remembered.
TEXT_AGAIN_S, MOST_TEXTS = 60.0, 64
#: Length of a STATUSTEXT that continues in the next one with its id, unless that is 0; and of the longest whole text.
TEXT_PIECE, LONGEST_TEXT = 50, 500
#: Time (s) within which the next piece arrives.
PIECE_S = 1.0
#: ArduPilot's answer to an origin while it has one, or waits for GPS.
ORIGIN_REFUSED = "refusing set origin"


class AutopilotStatus:
    """The state that one autopilot reports.

    Attributes:
        armed: Whether it is armed.
        mode: Number of its flight mode, in its own numbering; -1 while unknown.
        kind: MAV_AUTOPILOT and MAV_TYPE.
        battery_v: Voltage of its battery (V); NaN unknown.
    """

    def __init__(self, battery_wh: float = 0.0) -> None:
        """Starts unknown.

        Args:
            battery_wh: Energy of the full battery (Wh), from which the energy used is subtracted; 0: the autopilot
                reports the charge.
        """
        self.armed, self.mode = False, -1
        self.kind: tuple[int, int] = (mavlink.MAV_AUTOPILOT_INVALID, mavlink.MAV_TYPE_GENERIC)
        self.battery_v = math.nan
        self._battery_wh = battery_wh
        self._charge, self._charge_s = math.nan, -math.inf
        self._leak_s = -math.inf
        self._texts: dict[str, float] = {}  # warnings, and when they were returned
        self._whole: list[str] = []  # texts that were not returned yet
        self._piece_id, self._pieces, self._piece_s = 0, "", -math.inf  # of a text that continues

    @property
    def is_ardupilot(self) -> bool:
        """Whether it is ArduPilot."""
        return bool(self.kind[0] == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)

    def heartbeat(self, message: Message) -> None:
        """Handles a HEARTBEAT."""
        self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        self.mode = int(message.custom_mode)
        self.kind = (message.autopilot, message.type)

    def power(self, now_s: float, message: Message) -> None:
        """Handles SYS_STATUS (charge and voltage) or BATTERY_STATUS (energy used since the autopilot's start)."""
        if message.get_type() == "BATTERY_STATUS":
            if self._battery_wh and message.id == 0 and message.energy_consumed >= 0:
                used_wh = message.energy_consumed / HJ_PER_WH
                self._charge, self._charge_s = max(1.0 - used_wh / self._battery_wh, 0.0), now_s
            return
        if not self._battery_wh and 0 <= message.battery_remaining <= 100:
            self._charge, self._charge_s = message.battery_remaining / 100.0, now_s
        if message.voltage_battery != 0xFFFF:
            self.battery_v = message.voltage_battery / 1000.0

    def charge_at(self, now_s: float) -> float:
        """Charge left, 0 to 1; NaN if it was not reported lately."""
        return self._charge if now_s - self._charge_s <= CHARGE_S else math.nan

    def text(self, now_s: float, message: Message) -> None:
        """Handles a STATUSTEXT."""
        if message.severity <= mavlink.MAV_SEVERITY_CRITICAL and "leak" in message.text.lower():
            self._leak_s = now_s
        if message.severity > mavlink.MAV_SEVERITY_WARNING:
            return
        if self._pieces and message.id != self._piece_id:  # its end was lost
            self._whole, self._pieces = [*self._whole, self._pieces], ""
        self._piece_id, self._pieces, self._piece_s = message.id, self._pieces + str(message.text), now_s
        if not message.id or len(message.text) < TEXT_PIECE or len(self._pieces) >= LONGEST_TEXT:
            self._whole, self._pieces = [*self._whole, self._pieces], ""

    def texts(self, now_s: float) -> list[str]:
        """The new texts that an operator should read; those whose end does not come after `PIECE_S`.

        A repeated text is returned once per `TEXT_AGAIN_S`.
        """
        if self._pieces and not 0.0 <= now_s - self._piece_s < PIECE_S:
            self._whole, self._pieces = [*self._whole, self._pieces], ""
        whole, self._whole = self._whole, []
        return [text for text in whole if self._is_news(now_s, text)]

    def _is_news(self, now_s: float, text: str) -> bool:
        if text in ROUTINE_TEXTS or now_s - self._texts.get(text, -math.inf) < TEXT_AGAIN_S:
            return False
        if len(self._texts) == MOST_TEXTS:
            del self._texts[next(iter(self._texts))]
        self._texts[text] = now_s
        return True

    def leaks(self, now_s: float) -> bool:
        """Whether the autopilot has recently reported a leak."""
        return now_s - self._leak_s < LEAK_REPORTED_S
