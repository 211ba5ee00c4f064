"""Checks a Micromodem before the dive: settings, clock, firmware, and what the mission file needs of it.

`ModemCheck` opens no port and reads no clock, changes nothing and transmits nothing: it sends queries one by one
($CCCFQ, $CCTMQ), and `findings` lists the answers. The driver sends its own settings when it starts, so a setting that
differs is a note, with the sentence that sets it by hand.
"""

import math

from auv_lse_common.mission_file.sections.modem import PAYLOAD_BYTES, ModemConfig
from auv_lse_common.support.device_findings import Finding
from auv_lse_common.vocabulary.modem_rates import RATES, packet_duration_s
from auv_lse_comms.micromodem.clock import clock_offset_s
from auv_lse_comms.micromodem.configuration import settings_of
from auv_lse_comms.micromodem.sentences.fields import SentenceError
from auv_lse_comms.micromodem.sentences.messages import read_message
from auv_lse_comms.micromodem.sentences.status_messages import ClockTime, ErrorReport, Revision, Setting
from auv_lse_comms.micromodem.sentences.wire import Sentence, SentenceReader

#: Settings that must be equal on all modems, and that only the owner can choose: band, carrier (Hz), bandwidth (Hz).
BAND = ("BND", "FC0", "BW0")
#: Attempts at each query.
TRIES = 2
#: Sources of the pulse per second with which a clock is synchronous.
_EXTERNAL = ("EXT", "EXT_SYNC")


class ModemCheck:
    """The dialogue with one modem.

    Attributes:
        version: Its firmware; "" if it has not reported it.
        over: Whether every query is answered or abandoned.
    """

    def __init__(self, config: ModemConfig, address: int) -> None:
        """Prepares the queries: `config` is from the mission file, `address` the vehicle's number."""
        self.version = ""
        self.over = False
        self._config, self._address = config, address
        self._wanted = settings_of(config, address)
        names = dict.fromkeys([setting.name for setting, _ in self._wanted] + list(BAND))
        self._queries = [Sentence("CCCFQ", (name,)) for name in names] + [Sentence("CCTMQ", ("0",))]
        self._at, self._tries, self._since_s = 0, 0, math.nan
        self._reader = SentenceReader()
        self._values: dict[str, str] = {}
        self._refused: dict[str, str] = {}
        self._clock: tuple[ClockTime, float] | None = None  # and its offset (s)
        self._out = bytearray()

    @property
    def answers(self) -> bool:
        """Whether the modem has answered."""
        return bool(self._values or self._refused or self._clock)

    def receive(self, now_s: float, data: bytes) -> None:
        """Processes bytes from the modem, possibly none, and lets time pass."""
        for sentence in self._reader.feed(data):
            try:
                message = read_message(sentence)
            except SentenceError:
                continue
            match message:
                case Setting():
                    self._values[message.name] = message.value
                    self._next("CCCFQ", message.name)
                case ClockTime():
                    self._clock = (message, clock_offset_s(message, now_s))
                    self._next("CCTMQ", "0")
                case ErrorReport(module="NMEA") if not self.over:
                    name = self._queries[self._at].fields[0]
                    self._refused[name] = message.detail
                    self._next(self._queries[self._at].type, name)
                case Revision(ident="AUV"):
                    self.version = message.version
        self._ask(now_s)

    def outgoing(self) -> bytes:
        """Bytes for the modem; returns each byte once."""
        data = bytes(self._out)
        self._out.clear()
        return data

    def _next(self, kind: str, name: str) -> None:
        if not self.over and self._queries[self._at] == Sentence(kind, (name,)):
            self._at, self._tries, self._since_s = self._at + 1, 0, math.nan
            self.over = self._at == len(self._queries)

    def _ask(self, now_s: float) -> None:
        if not self.over and now_s - self._since_s >= self._config.reply_timeout_s and self._tries >= TRIES:
            if not self.answers:  # to the first query: no modem is connected
                self.over = True
            else:
                self._next(*self._query_names())
        if not self.over and not now_s - self._since_s < self._config.reply_timeout_s:
            self._tries, self._since_s = self._tries + 1, now_s
            self._out += self._queries[self._at].encode()

    def _query_names(self) -> tuple[str, str]:
        query = self._queries[self._at]
        return query.type, query.fields[0]

    # ------------------------------------------------------------------ findings

    def findings(self) -> list[Finding]:
        """The findings: what was seen or is missing, and the cure."""
        if not self.answers:
            return [Finding(ok=False, text=self._silence())]
        return [*self._lines(), *self._setting_findings(), *self._band_findings(), *self._clock_findings()]

    def _silence(self) -> str:
        counts = self._reader.counts
        garbled = sum(counts.values()) - counts["sentences"]
        if garbled:
            return (
                f"{garbled} garbled lines and no answer to $CCCFQ,SRC. Try another speed (modem.baud, --baud), "
                "and keep RTS low"
            )
        return (
            "no answer to $CCCFQ,SRC. Check power, cable, that transmit and receive are not swapped, the port "
            "and its speed (modem.baud)"
        )

    def _lines(self) -> list[Finding]:
        config, counts = self._config, self._reader.counts
        garbled = sum(counts.values()) - counts["sentences"]
        rate = RATES[config.rate]
        seconds = packet_duration_s(config.rate, PAYLOAD_BYTES)
        unknown = "not reported yet; --configure restarts the modem, which then reports it"
        return [
            Finding(ok=garbled == 0, text=f"line: {counts['sentences']} sentences, {garbled} garbled lines"),
            Finding(ok=True if self.version else None, text=f"firmware: {self.version or unknown}"),
            Finding(
                ok=None,
                text=f"rate {config.rate}: {rate.frames} frames of {rate.frame_bytes} bytes; a {PAYLOAD_BYTES}-byte "
                f"packet takes {seconds:.1f} s. --send tries it",
            ),
        ]

    def _setting_findings(self) -> list[Finding]:
        found = []
        for setting, required in self._wanted:
            by_hand = f"the driver sets it; by hand: {setting.command().encode().decode('ascii').strip()}"
            name, value = setting.name, self._values.get(setting.name)
            if value == setting.value:
                found.append(Finding(ok=True, text=f"{name} = {value}"))
            elif value is not None:
                doubt = f" (is it the modem of vehicle {value}?)" if name == "SRC" and value != "0" else ""
                found.append(Finding(ok=None, text=f"{name} = {value}, but must be {setting.value}{doubt}: {by_hand}"))
            else:
                why = self._refused.get(name, "no answer")
                text = f"{name}: {why}; it must be {setting.value}"
                found.append(Finding(ok=False if required else None, text=text))
        return found

    def _band_findings(self) -> list[Finding]:
        own = {name for name in BAND if name in self._values} - set(self._config.settings)
        if not own:
            return []
        values = ", ".join(f"{name} = {self._values[name]}" for name in BAND if name in own)
        text = f"{values}: must be equal on all modems; modem.settings in the mission file keeps them so"
        return [Finding(ok=None, text=text)]

    def _clock_findings(self) -> list[Finding]:
        if self._clock is None:
            return [Finding(ok=False, text="clock: no answer to $CCTMQ,0; packets cannot be timed")]
        message, offset_s = self._clock
        config = self._config
        right = abs(offset_s) <= config.clock_tolerance_s
        text = (
            f"clock: {offset_s:+z.1f} s from this computer's, set from {message.source}, disciplined by {message.pps}"
        )
        if not right:
            text += f", more than {config.clock_tolerance_s:g} s"
            text += ": the driver sets it" if config.set_clock else ". Set it, or modem.set_clock: true"
        found = [Finding(ok=right or (None if config.set_clock else False), text=text)]
        if config.synchronous:
            pps = message.pps in _EXTERNAL
            starts = self._values.get("SNV") == "1"
            wish = "modem.synchronous needs EXT. Connect a pulse per second to every modem, or use modem.ping"
            text = f"PPS: {message.pps}" + ("" if pps else f"; {wish}")
            found.append(Finding(ok=pps or (False if starts else None), text=text))
        return found
