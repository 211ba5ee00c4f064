"""auv_lse autopilot-check: connects to an autopilot, or a simulation of one, and reports what is missing."""

import argparse
import math
import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from auv_lse_common.mission_file.parameters import ParameterError, from_mapping
from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.support.device_findings import Finding, print_findings
from auv_lse_comms.packet.key import KeyFileError, new_nonce, read_key
from auv_lse_comms.transport import AddressError, Connection, open_transport, read_address
from auv_lse_mavlink.autopilot_check import AutopilotCheck, CheckOptions
from auv_lse_mavlink.messages.datum import Origin

_BAUD = 115200
_STEP_S = 0.02
#: Longest wait for a heartbeat (s); period of the requests for unanswered parameters (s).
_HEARD_S, _ASK_S = 10.0, 2.0
#: Time (s) for an answer to a changed parameter, and number of times that a key is sent.
_SET_S, _KEY_TRIES = 0.5, 3

ERRORS = (ParameterError, AddressError, KeyFileError)


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser(
        prog="auv_lse autopilot-check",
        description="Connects to a MAVLink autopilot, or a simulation of one (SITL), checks its message rates, origin, "
        "mode, arming and parameters, and reports what is missing. It neither arms the vehicle nor changes its mode. "
        "Only --apply changes parameters.",
        epilog="Exit codes: 0 nothing is missing; 1 something is missing, or no autopilot is heard; 2 wrong "
        "command line; 130 Ctrl-C. What to set: docs/guide/mavlink-vehicle.md.",
    )
    p.add_argument(
        "endpoint", metavar="ENDPOINT", help="as link.endpoint: udpin://0.0.0.0:14550, serial:///dev/ttyACM0"
    )
    p.add_argument(
        "--vehicle", type=int, default=1, metavar="N", help="the vehicle's number and system id (default: 1)"
    )
    modes = ("position_target", "mission")
    p.add_argument("--mode", choices=modes, default=modes[0], help="as link.mode (default: %(default)s)")
    p.add_argument(
        "--pressure", default="SCALED_PRESSURE2", metavar="MESSAGE", help="as link.pressure (default: %(default)s)"
    )
    p.add_argument("--key", type=Path, metavar="FILE", help="as link.key_file: sign, and accept only signed messages")
    p.add_argument("--seconds", type=float, default=10.0, metavar="S", help="seconds to listen (default: 10)")
    p.add_argument(
        "--depth",
        type=float,
        default=math.nan,
        metavar="M",
        help="deepest water of the mission (m), which the sounder must reach",
    )
    p.add_argument(
        "--origin",
        type=float,
        nargs=2,
        metavar=("LAT", "LON"),
        help="set this origin (deg) if the autopilot has none, as without GPS; as area.origin_lat_deg, origin_lon_deg",
    )
    p.add_argument(
        "--afloat",
        type=float,
        default=0.0,
        metavar="M",
        help="the vehicle floats, with its pressure sensor this deep (m): link.zero_afloat and link.sensor_depth_m",
    )
    p.add_argument(
        "--port", type=int, default=0, metavar="N", help="number of the autopilot's port, n in SRn_... (default: 0)"
    )
    p.add_argument("--apply", action="store_true", help="set the proposed parameters, after showing them, and verify")
    p.add_argument(
        "--send-key", action="store_true", help="give the autopilot the key of --key first (SETUP_SIGNING); use a cable"
    )
    p.add_argument(
        "--legs",
        action="store_true",
        help="MOVES THE VEHICLE: three legs of 20 m at its present depth, ahead, to starboard, and back",
    )
    return p


def run(options: argparse.Namespace) -> int:
    """Checks an autopilot. Returns 0 or 1, see --help."""
    address = read_address(options.endpoint, _BAUD)
    values = {"endpoint": options.endpoint, "pressure": options.pressure}
    values |= {"zero_afloat": options.afloat > 0.0, "sensor_depth_m": options.afloat}
    config = from_mapping(LinkConfig, values, "command line")
    key = read_key(options.key) if options.key else None
    if options.send_key and key is None:
        raise ParameterError("--send-key needs --key FILE.")
    if not 1 <= options.vehicle <= 255:
        raise ParameterError(f"--vehicle must be 1 to 255, not {options.vehicle}")
    origin = Origin(lat_deg=options.origin[0], lon_deg=options.origin[1]) if options.origin else None
    wanted = CheckOptions(mission=options.mode == "mission", origin=origin, depth_m=options.depth, port=options.port)
    check = AutopilotCheck(config, options.vehicle, wanted, key, new_nonce(), time.monotonic)
    connection = Connection(lambda: open_transport(address, check.link.recognizes), 0.2, 1.0)
    try:
        return _run(Session(check, connection), options)
    finally:
        connection.close(time.monotonic(), "done")


class Session:
    """A check on its connection, in real time."""

    def __init__(self, check: AutopilotCheck, connection: Connection) -> None:
        """Runs `check` on `connection`."""
        self.check, self._connection = check, connection
        self._asked_s = time.monotonic()

    def step(self) -> None:
        """Transfers bytes both ways, and requests unknown parameters; takes `_STEP_S`."""
        steady_s = time.monotonic()
        self._connection.poll(steady_s)
        self.check.receive(self.now_s, self._connection.read(steady_s))
        if steady_s - self._asked_s >= _ASK_S:
            self._asked_s = steady_s
            self.check.ask()
        for datagram in self.check.outgoing():
            self._connection.write(datagram, steady_s)
        time.sleep(_STEP_S)

    def wait(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Waits for a time, or until a condition holds; returns whether it does."""
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            self.step()
            if until():
                return True
        return False

    @property
    def now_s(self) -> float:
        """The time (s since 1970), for signatures."""
        return datetime.now(tz=UTC).timestamp()

    @property
    def problem(self) -> list[Finding]:
        """Why the connection does not work."""
        return [Finding(ok=False, text=self._connection.problem)] if self._connection.problem else []


def _run(session: Session, options: argparse.Namespace) -> int:
    """Listens, and sets parameters or travels the legs if wanted; prints findings; returns the exit code."""
    check = session.check
    print(f"listening for {options.seconds:g} s", flush=True)
    if options.send_key:
        for _ in range(_KEY_TRIES):
            check.send_key(session.now_s)
            session.wait(1.0, lambda: check.heard)
    if not session.wait(_HEARD_S, lambda: check.heard):
        return print_findings([*session.problem, *check.findings()])
    session.wait(options.seconds)
    if options.apply:
        return _apply(session)
    if options.legs:
        print("travelling three legs" + (f". At the end: {check.farewell}" if check.farewell else ""), flush=True)
        check.fly(session.now_s)
        while check.flying:
            session.step()
    code = print_findings(check.findings())
    if changes := check.changes():
        print(f"{len(changes)} parameters to change; --apply sets them")
    return code


def _apply(session: Session) -> int:
    """Shows the changes, sets and verifies them; returns the exit code."""
    check = session.check
    changes = check.changes()
    if check.link.report.armed:
        print("error: the vehicle is armed; disarm it before its parameters are changed", file=sys.stderr)
        return 1
    for change in changes:
        print(f"{change.name}: {change.before:g} -> {change.after:g} ({change.why})")
    if not changes:
        print("no parameter needs a change")
        return 0
    check.parameters.apply(changes)
    while check.parameters.is_applying:
        check.parameters.step()
        session.wait(_SET_S, lambda: not check.parameters.is_applying)
    return print_findings(check.parameters.applied())
