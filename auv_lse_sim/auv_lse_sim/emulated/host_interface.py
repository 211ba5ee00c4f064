"""The emulated modem's settings and clock, and the sentences that it writes to its host."""

import math
from collections import Counter

from auv_lse_comms.micromodem.sentences.fields import clock_time, read_iso_time
from auv_lse_comms.micromodem.sentences.layout import Message
from auv_lse_comms.micromodem.sentences.status_messages import ClockSet, ClockTime, ErrorReport, Setting
from auv_lse_comms.micromodem.sentences.wire import Sentence

#: Settings that the emulator knows, with their factory values.
SETTINGS = {"SRC": "0", "CST": "0", "RXP": "0", "REV": "0", "XST": "0", "MFD": "0", "ASD": "0", "SNV": "0"}
SETTINGS |= {"TXP": "1", "TXF": "1", "RXD": "1", "BND": "1"}

_RTC_USER_COMMAND = 2
_PPS_EXTERNAL = 3 << 2


class HostInterface:
    """The host's side of an emulated modem: settings, clock and sentences.

    Attributes:
        settings: Values by name, as text.
        counts: Events by name; "refused" is counted here.
        clock_error_s: The modem's clock minus the simulation's clock (s).
        pps: Whether a PPS is connected; it is used with SNV on.
    """

    def __init__(self, clock_error_s: float, pps: bool) -> None:
        """Starts with factory settings."""
        self.settings = dict(SETTINGS)
        self.counts: Counter[str] = Counter()
        self.clock_error_s = clock_error_s
        self.pps = pps
        self._clock_set = False
        self._out = bytearray()

    @property
    def address(self) -> int:
        """The modem's address, 0 until it is set."""
        return int(self.settings["SRC"])

    def reset(self) -> None:
        """Restores the factory settings; the clock counts as unset."""
        self.settings |= SETTINGS
        self._clock_set = False

    def write(self, message: Message) -> None:
        """Queues a sentence for the host."""
        self._out += message.sentence().encode()

    def outgoing(self) -> bytes:
        """Bytes for the host; returns each byte once."""
        data = bytes(self._out)
        self._out.clear()
        return data

    def refuse(self, now_s: float, number: int, reason: str) -> None:
        """Reports an error to the host."""
        self.counts["refused"] += 1
        self.write(ErrorReport(time=self.clock_text(now_s), module="NMEA", number=number, detail=reason))

    # ------------------------------------------------------------------ clock

    def clock_text(self, now_s: float) -> str:
        """The modem's time of day."""
        return clock_time(self.utc_s(now_s))

    def utc_s(self, now_s: float) -> float:
        """The modem's time (s) at the simulation's time `now_s` (s)."""
        return max(0.0, now_s + self.clock_error_s)

    @property
    def clock_status(self) -> int:
        """The clock's source and its synchronization, as `$CACST` and `$CAXST` encode them."""
        rtc = _RTC_USER_COMMAND if self._clock_set else 1
        return rtc | (_PPS_EXTERNAL if self.synchronized else 1 << 2)

    @property
    def synchronized(self) -> bool:
        """Whether the clock follows the PPS."""
        return self.pps and self.settings["SNV"] != "0"

    # ------------------------------------------------------------------ the host's sentences

    def set_value(self, now_s: float, sentence: Sentence) -> None:
        """Answers `$CCCFG`: sets a value."""
        setting = Setting.read(sentence.fields)
        if setting.name not in self.settings or not setting.value.isdigit():
            self.refuse(now_s, 4, f"{setting.name}: unknown setting or value")
            return
        if setting.name == "SRC" and not 0 <= int(setting.value) <= 127:
            self.refuse(now_s, 4, "SRC: out of range")
            return
        self.settings[setting.name] = setting.value
        self.write(setting)

    def query_value(self, now_s: float, sentence: Sentence) -> None:
        """Answers `$CCCFQ`: reports one value or all."""
        name = sentence.fields[0] if sentence.fields else ""
        names = list(self.settings) if name == "ALL" else [name]
        if names[0] not in self.settings:
            self.refuse(now_s, 4, f"{name}: unknown setting")
            return
        for known in names:
            self.write(Setting(name=known, value=self.settings[known]))

    def set_clock(self, now_s: float, sentence: Sentence) -> None:
        """Answers `$CCTMS`: sets the clock."""
        text = sentence.fields[0] if sentence.fields else ""
        # WHOI's acomms 3.1.1 ends the time in "ZZ", and real modems accept it
        wanted_s, _ = read_iso_time(text.rstrip("Z"), "time")
        at_edge = sentence.fields[1:2] == ("1",)  # the time holds from the next edge of the PPS on
        self.clock_error_s = wanted_s - (math.floor(now_s) + 1.0 if at_edge else now_s)
        self._clock_set = True
        self.write(ClockSet(timed_out=False, utc_s=wanted_s))

    def query_clock(self, now_s: float, sentence: Sentence) -> None:
        """Answers `$CCTMQ`: reports the clock."""
        source = "USER_CMD" if self._clock_set else "RTC"
        pps = "EXT" if self.synchronized else "RTC"
        self.write(ClockTime(utc_s=self.utc_s(now_s), resolution_s=1.0, source=source, pps=pps))
