"""auv_lse vehicle-side: what `auv_lse fleet` runs on a vehicle, over SSH."""

import argparse
import contextlib
import os
import sys
from pathlib import Path

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_run.process.domain import VEHICLE_DOMAINS, DomainError, domain_number
from auv_lse_run.remote.session import Session, Stream
from auv_lse_run.remote.wire import WireError
from auv_lse_run.vehicle.run_vehicle import vehicle_number

ERRORS = (DomainError, ParameterError, WireError)


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse vehicle-side."""
    p = argparse.ArgumentParser(
        prog="auv_lse vehicle-side",
        description="Answers auv_lse fleet on a vehicle, over standard input and output. auv_lse fleet runs it over "
        "SSH; nobody types it, except to see whether it is found.",
        epilog="Exit codes: 0 the laptop has disconnected; 2 wrong command line; 130 Ctrl-C.",
    )
    p.add_argument("name", metavar="VEHICLE", help="the vehicle, such as auv2")
    p.add_argument(
        "--folder",
        type=Path,
        default=Path(),
        metavar="DIR",
        help="the vehicle's folder, for mission file and dives (default: the current one)",
    )
    p.add_argument("--domain", metavar="N", help="ROS domain of the vehicle's nodes (default: 80 plus its number)")
    return p


def run(options: argparse.Namespace) -> int:
    """Answers requests until standard input ends."""
    number = vehicle_number(options.name)
    domain = domain_number(options.domain) if options.domain else VEHICLE_DOMAINS[0] - 1 + number
    answers = os.dup(1)
    os.dup2(2, 1)  # whatever else prints must not end up between the answers
    sys.stdout = sys.stderr
    with contextlib.suppress(BrokenPipeError):  # the link was cut
        Session(options.folder.expanduser().absolute(), number, domain).serve(Stream(0, answers))
    return 0
