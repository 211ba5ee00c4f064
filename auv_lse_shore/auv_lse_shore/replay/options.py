"""The command line of auv_lse replay."""

import argparse
from pathlib import Path

from auv_lse_common.support.atomic_files import check_file, check_folder

#: What can be recomputed from a recording.
PARTS = ("gp", "planner")
#: Relative difference of recomputed values that is ignored: the rounding of other machines.
TOLERANCE = 1e-9


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse replay."""
    p = argparse.ArgumentParser(
        prog="auv_lse replay",
        description="Plays a recording on its own ROS domain, for any viewer; or recomputes its maps and decisions and "
        "reports what differs (--recompute); or renews its report (--report).",
        epilog="keys while it plays: space: pause or resume; right: next message during a pause; up, down: faster, "
        "slower. Exit codes: 0 success (recomputed: nothing differs); 1 something differs, or it failed; 2 bad "
        "request; 130 Ctrl-C.",
    )
    p.add_argument(
        "run",
        type=Path,
        metavar="RUN",
        help="run folder, rosbag2 directory (also of `ros2 bag record`), or its .mcap or .db3 file",
    )
    _add_playing(p)
    _add_recomputing(p)
    p.add_argument(
        "--mission", type=Path, metavar="FILE", help="mission file that was flown, if the recording lacks it"
    )
    return p


def _add_playing(p: argparse.ArgumentParser) -> None:
    play = p.add_argument_group("playing")
    play.add_argument(
        "--rate", type=float, default=1.0, metavar="X", help="speed, in multiples of real time (default: 1)"
    )
    play.add_argument("--start", type=float, default=0.0, metavar="S", help="seconds into the recording to begin at")
    play.add_argument("--duration", type=float, metavar="S", help="seconds of the recording to play (default: all)")
    play.add_argument(
        "--topics",
        nargs="+",
        metavar="NAME",
        help="topics to play, with wildcards ('/auv1/*'); the clock is always played",
    )
    play.add_argument("--loop", action="store_true", help="start over at the end")
    play.add_argument("--paused", action="store_true", help="start paused, to leave time to start a viewer")
    play.add_argument(
        "--commands",
        action="store_true",
        help="also play waypoints, mission/command, mission/state and modem/tx, on which vehicles and modems act",
    )
    play.add_argument(
        "--domain",
        metavar="N",
        help="ROS domain to play on (default: a free one)",
    )


def _add_recomputing(p: argparse.ArgumentParser) -> None:
    again = p.add_argument_group("recomputing, without ROS")
    again.add_argument(
        "--recompute",
        type=_parts,
        metavar="PARTS",
        help="gp, planner or gp,planner: feed the recorded inputs to the current code and compare",
    )
    again.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="change a parameter first; may be repeated"
    )
    again.add_argument("--all", action="store_true", help="list every step, not only differences")
    again.add_argument("--csv", type=Path, metavar="FILE", help="also write every step to a CSV file")
    again.add_argument(
        "--tolerance",
        type=float,
        default=TOLERANCE,
        metavar="X",
        help="relative difference of values that is ignored (default: 1e-9, the rounding of other machines)",
    )
    again.add_argument("--report", action="store_true", help="renew summary, figures and report.html")
    again.add_argument("--out", type=Path, metavar="DIR", help="folder of the report (default: RUN)")


def check(options: argparse.Namespace) -> None:
    """Rejects options that would be ignored, and numbers out of range.

    Raises:
        ValueError: naming the option.
        OSError: if the folder of --out cannot be written.
    """
    if options.recompute and options.report:
        raise ValueError("--recompute and --report exclude each other; choose one")
    for name, needed in (("set", "recompute"), ("csv", "recompute"), ("all", "recompute"), ("out", "report")):
        if getattr(options, name) and not getattr(options, needed):
            raise ValueError(f"--{name} requires --{needed}")
    if options.tolerance != TOLERANCE and not options.recompute:
        raise ValueError("--tolerance requires --recompute")
    if options.mission is not None and not (options.recompute or options.report):
        raise ValueError("--mission requires --recompute or --report; playing needs no mission file")
    playing = {"rate": 1.0, "start": 0.0, "duration": None, "topics": None, "loop": False, "paused": False,
               "commands": False, "domain": None}  # fmt: skip
    for name, default in playing.items():
        if getattr(options, name) != default and (options.recompute or options.report):
            raise ValueError(f"--{name} plays a recording, so it excludes --recompute and --report")
    if options.csv is not None:
        check_file(options.csv, "--csv")
    if options.out is not None:
        check_folder(options.out)
    if not options.tolerance >= 0.0:
        raise ValueError(f"--tolerance must be at least 0, not {options.tolerance:g}")


def _parts(text: str) -> tuple[str, ...]:
    parts = tuple(part.strip() for part in text.split(","))
    for part in parts:
        if part not in PARTS:
            raise argparse.ArgumentTypeError(
                f"{part!r} is neither of {', '.join(PARTS)}; give one, or both with a comma"
            )
    return parts
