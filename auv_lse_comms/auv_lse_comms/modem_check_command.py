"""auv_lse modem-check: connects to a Micromodem-2, or an emulated one, and reports what is missing."""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

from auv_lse_common.mission_file.parameter_file import parameters_for, read_parameter_file
from auv_lse_common.mission_file.parameters import ParameterError, from_mapping
from auv_lse_common.mission_file.sections.modem import PAYLOAD_BYTES, ModemConfig
from auv_lse_common.mission_file.strict_yaml import yaml_value
from auv_lse_common.support.device_findings import Finding, print_findings
from auv_lse_common.support.plurals import counted
from auv_lse_comms.micromodem import events
from auv_lse_comms.micromodem.modem_check import ModemCheck
from auv_lse_comms.micromodem.port import Event, ModemPort
from auv_lse_comms.transport import AddressError, Connection, open_transport, read_address

_STEP_S = 0.01
#: Other speeds (Bd) to try on a serial port whose modem does not answer.
_SPEEDS = (19200, 9600, 38400, 57600, 115200, 4800)
#: Longest wait (s) for the driver to configure the modem.
_READY_S = 40.0
#: Speed of sound (m/s) for the printed distance.
_SOUND_MPS = 1500.0
#: The test packet: no packet of a mission, so that nodes that hear it reject it.
TEST_PACKET = (b"auv_lse modem-check " * 13)[:PAYLOAD_BYTES]

ERRORS = (ParameterError, AddressError)


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser(
        prog="auv_lse modem-check",
        description="Connects to a WHOI Micromodem-2 and reports its settings, clock and firmware, what differs from "
        "the mission file, and what to type. Without further options it changes and transmits nothing. "
        "Run it while the vehicle's nodes are not running.",
        epilog="--ping and --send TRANSMIT: the transducer must be under water. "
        "Exit codes: 0 nothing is missing, and what was tried has worked; 1 something is missing, or no modem answers; "
        "2 wrong command line; 130 Ctrl-C. Two modems in a bucket: docs/guide/bench-to-water.md.",
    )
    p.add_argument("port", metavar="PORT", help="as modem.port: /dev/ttyUSB0, tcp://HOST:PORT")
    p.add_argument(
        "--vehicle", type=int, default=1, metavar="N", help="number of the vehicle, its modem's address (default: 1)"
    )
    p.add_argument("--mission", type=Path, metavar="FILE", help="mission file with the section modem to check against")
    p.add_argument("--baud", type=int, metavar="BD", help="as modem.baud (default: 19200)")
    p.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="a modem setting to check, as modem.settings"
    )
    p.add_argument("--configure", action="store_true", help="let the driver restart and configure the modem first")
    p.add_argument("--ping", type=int, metavar="ID", help="configure, then ping modem ID")
    p.add_argument("--send", type=int, metavar="ID", help="configure, then send test packets to modem ID; 0: to all")
    p.add_argument("--listen", type=float, metavar="S", help="configure, then print up to N packets within S seconds")
    p.add_argument("--count", type=int, default=3, metavar="N", help="number of pings and packets (default: 3)")
    return p


def run(options: argparse.Namespace) -> int:
    """Checks a modem. Returns 0 or 1, see --help."""
    read_address(options.port)  # names the argument; the configuration would name its section
    config = _config(options)
    for name, low, high in (("vehicle", 1, 127), ("ping", 1, 127), ("send", 0, 127), ("count", 1, 1000)):
        value = getattr(options, name)
        if value is not None and not low <= value <= high:
            raise ParameterError(f"--{name} must be {low} to {high}, not {value}")
    if options.vehicle in (options.ping, options.send):
        raise ParameterError(f"--ping, --send: {options.vehicle} is --vehicle's own modem; choose another")
    if options.listen is not None and not options.listen > 0.0:
        raise ParameterError(f"--listen must be more than 0 s, not {options.listen:g}")
    return print_findings(_findings(config, options))


def _config(options: argparse.Namespace) -> ModemConfig:
    """Section `modem` of the mission file, with the values of the command line."""
    values = {}
    if options.mission is not None:
        own = parameters_for(read_parameter_file(options.mission), f"/auv{options.vehicle}/micromodem_node")
        values = dict(own.get("modem", {}))
    if options.set:
        pairs = (text.partition("=") for text in options.set)
        values["settings"] = {**values.get("settings", {}), **{name: yaml_value(v) for name, _, v in pairs}}
    values |= {"kind": "micromodem", "port": options.port, "log_file": ""}
    if options.baud is not None:
        values["baud"] = options.baud
    return from_mapping(ModemConfig, values, "section modem")


def _now_s() -> float:
    return datetime.now(tz=UTC).timestamp()


# asking ---------------------------------------------------------------------------------------------------------------


def _findings(config: ModemConfig, options: argparse.Namespace) -> list[Finding]:
    check, problem = _asked(config, options.vehicle)
    if not check.answers:
        return [problem] if problem else [*check.findings(), *_other_speeds(config, options.vehicle)]
    if not (options.configure or options.ping or options.listen or options.send is not None):
        return check.findings()
    tried = _Trial(config, options.vehicle).run(options)
    version = check.version
    check, problem = _asked(config, options.vehicle)
    check.version = check.version or version or tried.version
    return [*check.findings(), *tried.found]


def _asked(config: ModemConfig, address: int) -> tuple[ModemCheck, Finding | None]:
    """The check after all queries; and why the port cannot be opened, if it cannot."""
    check, where = ModemCheck(config, address), read_address(config.port, config.baud)
    connection = Connection(lambda: open_transport(where, lines_low=True), 0.2, 1.0)
    try:
        while not check.over:
            steady_s = time.monotonic()
            connection.poll(steady_s)
            if connection.problem:
                return check, Finding(ok=False, text=connection.problem)
            check.receive(_now_s(), connection.read(steady_s))
            connection.write(check.outgoing(), steady_s)
            time.sleep(_STEP_S)
    finally:
        connection.close(time.monotonic(), "done")
    return check, None


def _other_speeds(config: ModemConfig, address: int) -> Iterator[Finding]:
    """The speed at which a silent modem on a serial port answers, if there is one."""
    if read_address(config.port, config.baud).kind != "serial":
        return
    for baud in _SPEEDS:
        if baud == config.baud:
            continue
        print(f"trying {baud} Bd", flush=True)
        if _asked(dataclasses.replace(config, baud=baud), address)[0].answers:
            yield Finding(ok=None, text=f"it answers at {baud} Bd: set modem.baud: {baud}")
            return


# transmitting and receiving -------------------------------------------------------------------------------------------


class _Trial:
    """The driver on the port: configures the modem, pings, sends and listens.

    Attributes:
        found: What was tried, and whether it worked.
        version: Firmware that the modem has reported.
    """

    def __init__(self, config: ModemConfig, address: int) -> None:
        self.found: list[Finding] = []
        self.version = ""
        self._port = ModemPort(config, address)
        self._rate = config.rate
        self._heard = 0

    def run(self, options: argparse.Namespace) -> _Trial:
        """Tries what the options say; returns itself."""
        try:
            print("configuring the modem", flush=True)
            if not self._until(events.ModemReady, _READY_S):
                self._note(False, f"the driver could not configure the modem within {_READY_S:g} s")
                return self
            self.version = self._port.modem.version
            self._note(True, "the driver has configured the modem")
            if options.ping:
                self._ping(options.ping, options.count)
            if options.send is not None:
                self._send(options.send, options.count)
            if options.listen:
                self._listen(options.listen, options.count)
        finally:
            self._port.close(_now_s(), time.monotonic())
        return self

    def _note(self, ok: bool | None, text: str) -> None:
        self.found.append(Finding(ok=ok, text=text))

    def _until(self, wanted: type[Event] | tuple[type[Event], ...], seconds: float) -> Event | None:
        """The first event of a wanted type within a time; prints all others."""
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            found = None
            for event in self._port.step(_now_s(), time.monotonic()):
                if isinstance(event, wanted) and found is None:
                    found = event
                else:
                    self._show(event)
            if found is not None:
                return found
            time.sleep(_STEP_S)
        return None

    def _show(self, event: Event) -> None:
        match event:
            case events.Problem():
                self._note(None, event.text)
            case events.PacketReceived():
                self._heard += 1
                what = "test packet" if event.payload == TEST_PACKET else f"{len(event.payload)} bytes"
                about = f"modem {event.source}, rate {event.rate}, SNR {event.snr_db:.1f} dB"
                print(f"heard: {what} of {about}", flush=True)
            case events.ReceptionFailed():
                print(f"heard, but not decoded: {event.reason}", flush=True)

    def _ping(self, other: int, count: int) -> None:
        travels: list[float] = []

        def once() -> str:
            self._port.ping(_now_s(), other)
            event = self._until((events.PingAnswered, events.PingFailed), 15.0)
            if isinstance(event, events.PingAnswered):
                travels.append(event.travel_s)
                return f"answered, {1000.0 * event.travel_s:.1f} ms one way, {_SOUND_MPS * event.travel_s:.1f} m"
            return event.reason if isinstance(event, events.PingFailed) else "no answer"

        self._repeat(f"ping to modem {other}", once, count)
        text = f"ping: modem {other} answered {len(travels)} of {count}"
        self._note(len(travels) == count, text if len(travels) == count else f"{text}. Is it on, configured, in water?")

    def _send(self, other: int, count: int) -> None:
        durations: list[float] = []

        def once() -> str:
            began_s = time.monotonic()
            self._port.send(_now_s(), TEST_PACKET, other)
            event = self._until((events.TransmitDone, events.TransmitFailed), 15.0)
            if isinstance(event, events.TransmitDone):
                durations.append(time.monotonic() - began_s)
                return f"sent within {durations[-1]:.1f} s"
            return event.reason if isinstance(event, events.TransmitFailed) else "its end was not reported"

        self._repeat(f"test packet to {f'modem {other}' if other else 'all'}", once, count)
        text = f"send: {len(durations)} of {count} packets of {PAYLOAD_BYTES} bytes at rate {self._rate}"
        longest = f", at most {max(durations):.1f} s each" if durations else ""
        self._note(len(durations) == count, text + longest)

    def _repeat(self, what: str, once: Callable[[], str], count: int) -> None:
        for number in range(1, count + 1):
            print(f"{what} ({number} of {count}): {once()}", flush=True)

    def _listen(self, seconds: float, count: int) -> None:
        print(f"listening for {seconds:g} s", flush=True)
        end_s = time.monotonic() + seconds
        while self._heard < count and (left_s := end_s - time.monotonic()) > 0.0:
            event = self._until(events.PacketReceived, left_s)
            if event is not None:
                self._show(event)
        pings = self._port.modem.counts["pings_heard"]
        self._note(self._heard + pings > 0, f"listen: {counted(self._heard, 'packet')}, {counted(pings, 'ping')} heard")
