"""`python -m auv_lse_comms.micromodem FILE`: replays a modem's line log through the driver and prints its events."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from auv_lse_common.mission_file.parameters import from_mapping
from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_common.mission_file.strict_yaml import yaml_value
from auv_lse_common.support.user_error import error_text
from auv_lse_comms.micromodem.log import read_entries, replay_log


def main(arguments: Sequence[str] | None = None) -> int:
    """Replays a log and prints the driver's events.

    Returns:
        0; 1 if the driver's output differs from the log; 2 if the log cannot be read.
    """
    parser = argparse.ArgumentParser(
        prog="python -m auv_lse_comms.micromodem",
        description="Replays a modem's line log through the driver and prints its events.",
    )
    parser.add_argument("file", type=Path, help="the log, written to modem.log_file")
    parser.add_argument("--address", type=int, help="modem address, if the beginning of the log is missing")
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="a modem parameter of that run, e.g. rate=5"
    )
    options = parser.parse_args(arguments)
    try:
        values = {name: yaml_value(value) for name, _, value in (text.partition("=") for text in options.set)}
        config = from_mapping(ModemConfig, {"kind": "micromodem", "port": str(options.file), **values}, "--set: modem")
        with options.file.open(encoding="ascii") as lines:
            result = replay_log(read_entries(lines, str(options.file)), config, options.address)
    except (OSError, ValueError) as error:
        print(f"error: {error_text(error)}", file=sys.stderr)
        return 2
    for utc_s, event in result.events:
        print(f"{utc_s:.6f} {event}")
    lines_read = ", ".join(f"{count} {name}" for name, count in sorted(result.modem.reader.counts.items()))
    print(f"lines: {lines_read}; driver: {dict(sorted(result.modem.counts.items()))}")
    if result.written != result.logged:
        print("the driver's output differs from the log: other settings, or another driver version", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
