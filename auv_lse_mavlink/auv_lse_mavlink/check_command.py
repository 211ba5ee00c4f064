"""scripts/autopilot-check: connects to an autopilot, or a simulation of one, and reports what is missing."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from auv_lse_common.mission_file.parameters import ParameterError, from_mapping
from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.support.device_findings import Finding, print_findings
from auv_lse_comms.packet.key import KeyFileError, new_nonce, read_key
from auv_lse_comms.transport import AddressError, Connection, open_transport, read_address
from auv_lse_mavlink.autopilot_check import AutopilotCheck

_BAUD = 115200
_STEP_S = 0.02
#: Longest wait for a heartbeat (s); period of the requests for unanswered parameters (s).
_HEARD_S, _ASK_S = 10.0, 2.0


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser(
        prog="scripts/autopilot-check",
        description="Connects to a MAVLink autopilot, or a simulation of one (SITL), checks its message rates, origin, "
        "mode, arming and parameters, and reports what is missing. It neither arms the vehicle nor changes a mode or a "
        "parameter.",
        epilog="Exit codes: 0 nothing is missing; 1 something is missing, or no autopilot is heard; 2 wrong "
        "command line; 130 Ctrl-C. What to set: docs/guide/mavlink-vehicle.md.",
    )
    p.add_argument(
        "endpoint", metavar="ENDPOINT", help="as link.endpoint: udpin://0.0.0.0:14550, serial:///dev/ttyACM0"
    )
    p.add_argument("--vehicle", type=int, default=1, metavar="N", help="number of the vehicle, its system id (1)")
    p.add_argument(
        "--mode",
        choices=("position_target", "mission"),
        default="position_target",
        help="as link.mode: what is expected",
    )
    p.add_argument(
        "--pressure", default="SCALED_PRESSURE2", metavar="MESSAGE", help="as link.pressure (SCALED_PRESSURE2)"
    )
    p.add_argument("--key", type=Path, metavar="FILE", help="as link.key_file: sign, and accept only signed messages")
    p.add_argument("--seconds", type=float, default=10.0, metavar="S", help="how long to listen (10)")
    p.add_argument(
        "--legs",
        action="store_true",
        help="MOVES THE VEHICLE: three legs of 20 m at its present depth, ahead, to starboard, and back",
    )
    return p


def main(arguments: Sequence[str] | None = None) -> int:
    """Checks an autopilot. Returns 0, 1, 2 or 130, as the help says."""
    options = parser().parse_args(arguments)
    try:
        config = from_mapping(LinkConfig, {"endpoint": options.endpoint, "pressure": options.pressure}, "command line")
        address = read_address(options.endpoint, _BAUD)
        key = read_key(options.key) if options.key else None
        if not 1 <= options.vehicle <= 255:
            raise ParameterError(f"--vehicle: got {options.vehicle}; expected 1 to 255")
    except (ParameterError, AddressError, KeyFileError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    check = AutopilotCheck(config, options.vehicle, options.mode == "mission", key, new_nonce())
    connection = Connection(lambda: open_transport(address, check.link.recognizes), 0.2, 1.0)
    try:
        return print_findings(_run(check, connection, options.seconds, options.legs))
    except KeyboardInterrupt:
        return 130
    finally:
        connection.close(time.monotonic(), "done")


def _run(check: AutopilotCheck, connection: Connection, listen_s: float, legs: bool) -> list[Finding]:
    """Listens, requests parameters, and travels the legs if wanted; returns the findings."""
    began_s = asked_s = time.monotonic()
    heard_s: float | None = None
    asked_to_fly = False
    print(f"listening for {listen_s:g} s", flush=True)
    while True:
        steady_s = time.monotonic()
        connection.poll(steady_s)
        now_s = datetime.now(tz=UTC).timestamp()  # for signatures
        check.receive(now_s, connection.read(steady_s))
        if steady_s - asked_s >= _ASK_S:
            asked_s = steady_s
            check.ask()
        for datagram in check.outgoing():
            connection.write(datagram, steady_s)
        if heard_s is None and check.heard:
            heard_s = steady_s
        if heard_s is None and steady_s - began_s >= _HEARD_S:
            problem = [Finding(ok=False, text=connection.problem)] if connection.problem else []
            return [*problem, *check.findings()]
        if heard_s is not None and steady_s - heard_s >= listen_s:
            if legs and not asked_to_fly:
                asked_to_fly = True
                print("travelling three legs", flush=True)
                check.fly(now_s)
            if not check.flying:
                return check.findings()
        time.sleep(_STEP_S)


if __name__ == "__main__":
    sys.exit(main())
