"""An emulated WHOI Micromodem-2: the modem's side of the sentences, on a pty or on TCP, joined to a channel.

`ModemEmulator` is pure: bytes and times in, bytes out, and one callable, `transmit`, through which a packet goes
into the simulated water; what the water brings back comes in by `arrive`. `PtyShell` and `TcpShell` carry its bytes.
`EmulatorRack` holds one emulator and shell per vehicle and serves them all without threads.

The time is the caller's: simulated time in a mission. Answers come at once, however fast time runs; what takes time
in the water (a transmission, the wait for data) ends in `poll`. Not modelled: the speed of the serial line (a 252-byte
frame takes 0.28 s each way at 19200 Bd), acknowledgements, ranging, mini-packets.

Settings start as a modem fresh from the box: address 0, no statistics. A driver that does not configure it gets
neither packets nor `$CACST`.
"""

from __future__ import annotations

import contextlib
import math
import os
import select
import socket
import tty
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from auv_lse_comms.micromodem.fields import SentenceError, clock_time, read_iso_time
from auv_lse_comms.micromodem.messages import Message
from auv_lse_comms.micromodem.rates import BROADCAST, RATES, packet_duration_s
from auv_lse_comms.micromodem.receive_messages import (
    MODE_BAD_CRC,
    MODE_GOOD,
    Detection,
    FrameHeard,
    ReceptionStart,
    ReceptionStatistics,
)
from auv_lse_comms.micromodem.status_messages import ClockSet, ClockTime, ErrorReport, Notice, Revision, Setting
from auv_lse_comms.micromodem.transmit_messages import (
    Cycle,
    DataRequest,
    FrameGiven,
    FrameTaken,
    TransmitEnd,
    TransmitStart,
    TransmitStatistics,
)
from auv_lse_comms.micromodem.wire import Sentence, SentenceReader

VERSION = "2.0.27087"
#: The modem waits so long for `$CCTXD` after `$CADRQ` (s).
DATA_TIMEOUT_S = 2.0
#: With REV on, the revision is said this often (s).
REVISION_PERIOD_S = 120.0
#: Bytes kept for a host that does not read; more are dropped, oldest first, as a full line buffer does.
MAX_UNREAD_BYTES = 1 << 16

#: Settings known, and what they are at first.
SETTINGS = {"SRC": "0", "CST": "0", "RXP": "0", "REV": "0", "XST": "0", "MFD": "0", "ASD": "0", "SNV": "0"}

_RTC_USER_COMMAND = 2
_PPS_EXTERNAL = 3 << 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Transmission:
    """A packet that goes into the water.

    Attributes:
        start_s: When its transmission starts (s, the simulation's clock).
        source: The sender's modem address.
        destination: Whom it is for, 0: all.
        rate: Packet rate number.
        frames: Number of frames.
        payload: The frames' bytes, one after another.
    """

    start_s: float
    source: int
    destination: int
    rate: int
    frames: int
    payload: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrival:
    """A packet that comes out of the water.

    Attributes:
        start_s: When its first sound arrives (s, the simulation's clock).
        source: The sender's modem address.
        destination: Whom it is for, 0: all.
        payload: What was sent; None if it was heard but could not be decoded.
        snr_db: Signal to noise ratio (dB), not finite if unknown.
        rate: Packet rate number.
        frames: Number of frames.
        doppler_mps: Relative speed of the sender (m/s).
    """

    start_s: float
    source: int
    destination: int
    payload: bytes | None
    snr_db: float = math.nan
    rate: int = 4
    frames: int = 1
    doppler_mps: float = 0.0


@dataclass(slots=True)
class _Outgoing:
    cycle: Cycle
    asked_s: float
    frames: list[bytes] = field(default_factory=list)
    start_s: float = math.nan
    end_s: float = math.nan

    @property
    def started(self) -> bool:
        return not math.isnan(self.start_s)


class ModemEmulator:
    """One emulated modem.

    Attributes:
        settings: Its settings by name, as text.
        counts: What happened: "transmitted", "heard", "heard_bad", "data_timeouts", "refused", "boots".
    """

    def __init__(
        self, transmit: Callable[[Transmission], float | None], *, clock_error_s: float = 0.0, version: str = VERSION
    ) -> None:
        """A modem without power; `boot` it.

        Args:
            transmit: Takes a packet into the water; returns its duration (s), or None for the nominal one.
            clock_error_s: Modem's clock less the simulation's, until it is set.
            version: Firmware version said in `$CAREV`.
        """
        self.settings = dict(SETTINGS)
        self.counts: Counter[str] = Counter()
        self._transmit = transmit
        self._version = version
        self._clock_error_s = clock_error_s
        self._clock_set = False
        self._reader = SentenceReader()
        self._bad_lines = 0
        self._sending: _Outgoing | None = None
        self._revision_s = -math.inf
        self._out = bytearray()

    @property
    def address(self) -> int:
        """Own modem address, 0 until it is set."""
        return int(self.settings["SRC"])

    def boot(self, now_s: float, forget: bool = False) -> None:
        """Power on, or a restart: says so, drops what it was doing, and with `forget` its settings and clock too."""
        self.counts["boots"] += 1
        self._sending = None
        self._reader.reset()
        if forget:
            self.settings = dict(SETTINGS)
            self._clock_set = False
        self._say(Revision(time=self._clock_text(now_s), ident="INIT", version=""))
        self._say(Revision(time=self._clock_text(now_s), ident="AUV", version=self._version))
        self._revision_s = now_s

    def receive(self, now_s: float, data: bytes) -> None:
        """Takes bytes from the host."""
        for sentence in self._reader.feed(data):
            command = COMMANDS.get(sentence.type)
            if command is None:
                self._refuse(now_s, 1, f"{sentence.type}: unknown command")
                continue
            try:
                command(self, now_s, sentence)
            except SentenceError as error:
                self._refuse(now_s, 2, str(error).replace(",", ";"))
        bad_lines = sum(self._reader.counts.values()) - self._reader.counts["sentences"]
        if bad_lines > self._bad_lines:
            self._refuse(now_s, 3, "bad line")
        self._bad_lines = bad_lines

    def poll(self, now_s: float) -> None:
        """Lets time pass: ends transmissions, gives up waiting for data, says the revision."""
        sending = self._sending
        if sending is not None:
            if not sending.started:
                if len(sending.frames) >= sending.cycle.frames:
                    self._try_start(now_s)
                elif now_s - sending.asked_s >= DATA_TIMEOUT_S:
                    self._data_timeout(now_s)
            if sending.started and now_s >= sending.end_s:
                self._end(sending)
        if self.settings["REV"] != "0" and now_s - self._revision_s >= REVISION_PERIOD_S:
            self._revision_s = now_s
            self._say(Revision(time=self._clock_text(now_s), ident="AUV", version=self._version))

    def arrive(self, arrival: Arrival) -> None:
        """Tells the host of a packet from the water, as much of it as the settings let it."""
        good = arrival.payload is not None
        self.counts["heard" if good else "heard_bad"] += 1
        size = RATES[arrival.rate].frame_bytes
        payload = arrival.payload or b""
        snr_db = arrival.snr_db if math.isfinite(arrival.snr_db) else 0.0
        detection = Detection(
            peak=max(0, round(300 * 10 ** (min(snr_db, 40.0) / 40))),
            power_db=round(120 + snr_db),
            ratio_db=max(0, round(snr_db + 20)),
            spl_db=round(110 + snr_db),
        )
        self._say(
            Cycle(
                source=arrival.source,
                destination=arrival.destination,
                rate=arrival.rate,
                ack=False,
                frames=arrival.frames,
            )
        )
        if self.settings["RXP"] != "0":
            self._say(ReceptionStart(kind=0 if arrival.rate == 0 else 1))
        if self.settings["MFD"] != "0":
            self._say(detection)
        for number in range(1, arrival.frames + 1):
            if not good:
                self._say(Notice(kind="BAD_CRC", detail=str(number)))
            elif arrival.destination in (BROADCAST, self.address):
                self._say(
                    FrameHeard(
                        source=arrival.source,
                        destination=arrival.destination,
                        ack=False,
                        frame=number,
                        data=payload[(number - 1) * size : number * size],
                    )
                )
        if self.settings["CST"] != "0":
            self._say(
                ReceptionStatistics(
                    mode=MODE_GOOD if good else MODE_BAD_CRC,
                    utc_s=max(0.0, arrival.start_s + self._clock_error_s),
                    clock=self._clock_status,
                    detection=detection,
                    rate=arrival.rate,
                    source=arrival.source,
                    destination=arrival.destination,
                    frames=arrival.frames,
                    bad_frames=0 if good else arrival.frames,
                    snr_rss_db=round(snr_db),
                    snr_in_db=snr_db,
                    snr_out_db=snr_db,
                    snr_symbol_db=snr_db,
                    mse_db=-snr_db,
                    doppler_mps=arrival.doppler_mps,
                    noise_db=60,
                )
            )

    def outgoing(self) -> bytes:
        """Bytes for the host; they are handed out once."""
        data = bytes(self._out)
        self._out.clear()
        return data

    # ------------------------------------------------------------------ saying

    def _say(self, message: Message) -> None:
        self._out += message.sentence().encode()

    def _clock_text(self, now_s: float) -> str:
        return clock_time(max(0.0, now_s + self._clock_error_s))

    @property
    def _clock_status(self) -> int:
        rtc = _RTC_USER_COMMAND if self._clock_set else 1
        return rtc | (_PPS_EXTERNAL if self.settings["SNV"] != "0" else 1 << 2)

    def _refuse(self, now_s: float, number: int, why: str) -> None:
        self.counts["refused"] += 1
        self._say(ErrorReport(time=self._clock_text(now_s), module="NMEA", number=number, detail=why))

    # ------------------------------------------------------------------ commands

    def _on_set(self, now_s: float, sentence: Sentence) -> None:
        setting = Setting.read(sentence.fields)
        if setting.name not in self.settings or not setting.value.isdigit():
            self._refuse(now_s, 4, f"{setting.name}: unknown setting or value")
            return
        if setting.name == "SRC" and not 0 <= int(setting.value) <= 127:
            self._refuse(now_s, 4, "SRC: out of range")
            return
        self.settings[setting.name] = setting.value
        self._say(setting)

    def _on_query(self, now_s: float, sentence: Sentence) -> None:
        name = sentence.fields[0] if sentence.fields else ""
        names = list(self.settings) if name == "ALL" else [name]
        if names[0] not in self.settings:
            self._refuse(now_s, 4, f"{name}: unknown setting")
            return
        for known in names:
            self._say(Setting(name=known, value=self.settings[known]))

    def _on_clock_set(self, now_s: float, sentence: Sentence) -> None:
        text = sentence.fields[0] if sentence.fields else ""
        # WHOI's acomms 3.1.1 ends the time in "ZZ", and real modems take it
        wanted_s, _ = read_iso_time(text.rstrip("Z"), "time")
        self._clock_error_s = wanted_s - now_s
        self._clock_set = True
        self._say(ClockSet(timed_out=False, utc_s=wanted_s))

    def _on_clock_query(self, now_s: float, sentence: Sentence) -> None:
        source = "USER_CMD" if self._clock_set else "RTC"
        pps = "EXT" if self.settings["SNV"] != "0" else "RTC"
        utc_s = max(0.0, now_s + self._clock_error_s)
        self._say(ClockTime(utc_s=utc_s, resolution_s=1.0, source=source, pps=pps))

    def _on_cycle(self, now_s: float, sentence: Sentence) -> None:
        cycle = Cycle.read(sentence.fields)
        rate = RATES.get(cycle.rate)
        if rate is None or not 1 <= cycle.frames <= rate.frames:
            self._refuse(now_s, 5, f"rate {cycle.rate} with {cycle.frames} frames")
            return
        if self._sending is not None and self._sending.started:
            self._refuse(now_s, 6, "transmitting")
            return
        self._say(cycle)
        if cycle.source == self.address and self.address != 0:
            self._sending = _Outgoing(cycle=cycle, asked_s=now_s)
            self._request(now_s)

    def _on_frame(self, now_s: float, sentence: Sentence) -> None:
        frame = FrameGiven.read(sentence.fields)
        sending = self._sending
        self._say(FrameTaken(source=frame.source, destination=frame.destination, ack=frame.ack, count=len(frame.data)))
        if sending is None or sending.started:
            return  # a real modem keeps it for the next cycle; nothing of ours would be right in that
        size = RATES[sending.cycle.rate].frame_bytes
        if not 1 <= len(frame.data) <= size:
            self._refuse(now_s, 7, f"frame of {len(frame.data)} bytes: expected 1 to {size}")
            return
        sending.frames.append(frame.data)
        if len(sending.frames) < sending.cycle.frames:
            sending.asked_s = now_s
            self._request(now_s)
        else:
            self._try_start(now_s)

    # ------------------------------------------------------------------ sending

    def _request(self, now_s: float) -> None:
        assert self._sending is not None
        cycle = self._sending.cycle
        self._say(
            DataRequest(
                time=self._clock_text(now_s),
                source=cycle.source,
                destination=cycle.destination,
                ack=cycle.ack,
                max_bytes=RATES[cycle.rate].frame_bytes,
                frame=len(self._sending.frames) + 1,
            )
        )

    def _try_start(self, now_s: float) -> None:
        sending = self._sending
        assert sending is not None
        if self.settings["SNV"] != "0":
            fraction_s = (now_s + self._clock_error_s) % 1.0
            if min(fraction_s, 1.0 - fraction_s) > 0.02:
                return  # waits for the second
        sending.start_s = now_s
        payload = b"".join(sending.frames)
        self._say(TransmitStart(count=len(payload)))
        self.counts["transmitted"] += 1
        cycle = sending.cycle
        duration_s = self._transmit(
            Transmission(
                start_s=now_s,
                source=cycle.source,
                destination=cycle.destination,
                rate=cycle.rate,
                frames=len(sending.frames),
                payload=payload,
            )
        )
        sending.end_s = now_s + (duration_s if duration_s is not None else packet_duration_s(cycle.rate, len(payload)))

    def _end(self, sending: _Outgoing) -> None:
        self._sending = None
        count = sum(len(frame) for frame in sending.frames)
        self._say(TransmitEnd(count=count))
        self._say_transmit_statistics(sending, mode=0)

    def _data_timeout(self, now_s: float) -> None:
        sending, self._sending = self._sending, None
        assert sending is not None
        self.counts["data_timeouts"] += 1
        number = len(sending.frames) + 1
        self._say(ErrorReport(time=self._clock_text(now_s), module="DATA_TIMEOUT", number=number, detail=""))
        sending.start_s = now_s
        self._say_transmit_statistics(sending, mode=4)

    def _say_transmit_statistics(self, sending: _Outgoing, mode: int) -> None:
        if self.settings["XST"] == "0":
            return
        self._say(
            TransmitStatistics(
                utc_s=max(0.0, sending.start_s + self._clock_error_s),
                clock=self._clock_status,
                mode=mode,
                rate=sending.cycle.rate,
                source=sending.cycle.source,
                destination=sending.cycle.destination,
                frames_expected=sending.cycle.frames,
                frames_sent=len(sending.frames),
                count=sum(len(frame) for frame in sending.frames),
            )
        )


#: What each of the host's sentences does.
COMMANDS: dict[str, Callable[[ModemEmulator, float, Sentence], None]] = {
    "CCCFG": ModemEmulator._on_set,
    "CCCFQ": ModemEmulator._on_query,
    "CCTMS": ModemEmulator._on_clock_set,
    "CCTMQ": ModemEmulator._on_clock_query,
    "CCCYC": ModemEmulator._on_cycle,
    "CCTXD": ModemEmulator._on_frame,
}


# ----------------------------------------------------------------------------------------------- shells


class Shell(Protocol):
    """A port on which a host can reach an emulated modem."""

    @property
    def port(self) -> str:
        """Where the host finds it, as `modem.port` takes it."""
        ...

    def filenos(self) -> Iterable[int]:
        """File descriptors to wait on."""
        ...

    def read(self) -> bytes:
        """What the host has written; b"" if nothing."""
        ...

    def write(self, data: bytes) -> None:
        """Writes what the host takes at once; keeps the rest for the next call (b"" tries again)."""
        ...

    def close(self) -> None:
        """Takes the port away."""
        ...


class _Unread:
    """Bytes on their way to a host that reads slowly, or not at all."""

    def __init__(self) -> None:
        self._data = bytearray()
        self.dropped = 0

    def write(self, data: bytes, put: Callable[[bytes], int]) -> None:
        """Puts old bytes, then `data`; keeps what does not go."""
        self._data += data
        while self._data:
            try:
                count = put(bytes(self._data))
            except (BlockingIOError, InterruptedError):
                break
            except OSError:
                self._data.clear()
                break
            del self._data[:count]
        if len(self._data) > MAX_UNREAD_BYTES:
            self.dropped += len(self._data) - MAX_UNREAD_BYTES
            del self._data[: len(self._data) - MAX_UNREAD_BYTES]


class PtyShell:
    """A pseudo-terminal: to the host a serial device like any other."""

    def __init__(self, link: Path | None = None) -> None:
        """Makes the terminal.

        Args:
            link: Symbolic link to make to it (replacing one that is there), so that its name is known beforehand.
        """
        self._master, self._slave = os.openpty()  # the slave stays open here: the host may come and go
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._unread = _Unread()
        self._link = link
        self._device = os.ttyname(self._slave)
        if link is not None:
            link.parent.mkdir(parents=True, exist_ok=True)
            with contextlib.suppress(FileNotFoundError):
                link.unlink()
            link.symlink_to(self._device)

    @property
    def port(self) -> str:
        """The link, or the device."""
        return str(self._link) if self._link is not None else self._device

    def filenos(self) -> Iterable[int]:
        """See `Shell`."""
        return (self._master,)

    def read(self) -> bytes:
        """See `Shell`."""
        try:
            return os.read(self._master, 65536)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> None:
        """See `Shell`."""
        self._unread.write(data, lambda part: os.write(self._master, part))

    def close(self) -> None:
        """See `Shell`."""
        if self._master < 0:
            return
        os.close(self._master)
        os.close(self._slave)
        self._master = -1
        if self._link is not None:
            with contextlib.suppress(OSError):
                if os.readlink(self._link) == self._device:
                    self._link.unlink()


class TcpShell:
    """A TCP server on the loopback interface for one host at a time; a new one takes the place of the old."""

    def __init__(self, port: int = 0) -> None:
        """Listens on 127.0.0.1:`port`; 0 takes a free one."""
        self._server = socket.create_server(("127.0.0.1", port))
        self._server.setblocking(False)
        self._client: socket.socket | None = None
        self._unread = _Unread()

    @property
    def port(self) -> str:
        """`tcp://127.0.0.1:PORT`."""
        return f"tcp://127.0.0.1:{self._server.getsockname()[1]}"

    def filenos(self) -> Iterable[int]:
        """See `Shell`."""
        return (self._server.fileno(),) if self._client is None else (self._server.fileno(), self._client.fileno())

    def read(self) -> bytes:
        """See `Shell`; also takes a new host's call."""
        with contextlib.suppress(BlockingIOError):
            client, _ = self._server.accept()
            if self._client is not None:
                self._client.close()
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._client = client
            self._unread = _Unread()
        if self._client is None:
            return b""
        try:
            data = self._client.recv(65536)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._client.close()
            self._client = None
        return data

    def write(self, data: bytes) -> None:
        """See `Shell`; without a host the bytes go nowhere, as on an open line."""
        client = self._client
        if client is not None:
            self._unread.write(data, client.send)

    def close(self) -> None:
        """See `Shell`."""
        if self._client is not None:
            self._client.close()
        self._server.close()


# ----------------------------------------------------------------------------------------------- rack


class EmulatorRack:
    """One emulated modem per vehicle, each on its port, all joined to one channel; has no thread and no clock.

    The owner calls `serve` whenever a port may have something to say (its `fileno` becomes readable), and `poll` once
    a tick; both with the simulation's time.
    """

    def __init__(
        self, shells: Mapping[int, Shell], transmit: Callable[[int, Transmission], float | None], now_s: float = 0.0
    ) -> None:
        """Boots one modem per shell.

        Args:
            shells: Ports by vehicle.
            transmit: Takes (vehicle, packet) into the water; returns the duration (s), or None for the nominal one.
            now_s: The simulation's time.
        """
        self.shells = dict(shells)
        self.modems: dict[int, ModemEmulator] = {}
        self.transmitted: Counter[int] = Counter()
        self.delivered: Counter[int] = Counter()
        self._transmit = transmit
        self._epoll = select.epoll()
        self._watched: dict[int, int] = {}
        for vehicle in self.shells:
            self.modems[vehicle] = ModemEmulator(self._joined(vehicle))
            self.modems[vehicle].boot(now_s)
            self._flush(vehicle)

    @property
    def ports(self) -> dict[int, str]:
        """Where each vehicle's driver finds its modem, as `modem.port` takes it."""
        return {vehicle: shell.port for vehicle, shell in self.shells.items()}

    def fileno(self) -> int:
        """A file descriptor that is readable when `serve` has something to do."""
        return self._epoll.fileno()

    def serve(self, now_s: float) -> int:
        """Reads every port and answers; returns the number of bytes read. Never waits."""
        total = 0
        for vehicle, shell in self.shells.items():
            while data := shell.read():
                total += len(data)
                self.modems[vehicle].receive(now_s, data)
            self._flush(vehicle)
        return total

    def poll(self, now_s: float) -> None:
        """Lets time pass on every modem."""
        for vehicle, modem in self.modems.items():
            modem.poll(now_s)
            self._flush(vehicle)

    def arrive(self, vehicle: int, arrival: Arrival) -> None:
        """A packet has reached a vehicle: its modem tells the driver. Good ones for it count as delivered."""
        modem = self.modems[vehicle]
        if arrival.payload is not None and arrival.destination in (BROADCAST, modem.address):
            self.delivered[vehicle] += 1
        modem.arrive(arrival)
        self._flush(vehicle)

    def close(self) -> None:
        """Takes the ports away."""
        for shell in self.shells.values():
            shell.close()
        self._epoll.close()

    def _joined(self, vehicle: int) -> Callable[[Transmission], float | None]:
        def transmit(transmission: Transmission) -> float | None:
            self.transmitted[vehicle] += 1
            return self._transmit(vehicle, transmission)

        return transmit

    def _flush(self, vehicle: int) -> None:
        self.shells[vehicle].write(self.modems[vehicle].outgoing())
        self._watch()

    def _watch(self) -> None:
        wanted = {number for shell in self.shells.values() for number in shell.filenos()}
        for number in set(self._watched) - wanted:
            del self._watched[number]
            with contextlib.suppress(OSError):  # closing a file has taken it out already
                self._epoll.unregister(number)
        for number in wanted - set(self._watched):
            self._watched[number] = 1
            self._epoll.register(number, select.EPOLLIN)


def perfect_water(
    rack: Callable[[], EmulatorRack], delay_s: float = 0.5
) -> tuple[Callable[[int, Transmission], None], Callable[[float], None]]:
    """A channel for tests and the desk: everyone hears everything, `delay_s` later.

    Returns:
        `transmit` for an `EmulatorRack`, and `tick(now_s)`, which delivers what has arrived by then.
    """
    under_way: deque[tuple[float, int, Arrival]] = deque()

    def transmit(vehicle: int, packet: Transmission) -> None:
        end_s = packet.start_s + delay_s + packet_duration_s(packet.rate, len(packet.payload))
        for other in rack().modems:
            if other != vehicle:
                arrival = Arrival(
                    start_s=packet.start_s + delay_s,
                    source=packet.source,
                    destination=packet.destination,
                    payload=packet.payload,
                    snr_db=20.0,
                    rate=packet.rate,
                    frames=packet.frames,
                )
                under_way.append((end_s, other, arrival))

    def tick(now_s: float) -> None:
        for item in [item for item in under_way if item[0] <= now_s]:
            under_way.remove(item)
            rack().arrive(item[1], item[2])

    return transmit, tick
