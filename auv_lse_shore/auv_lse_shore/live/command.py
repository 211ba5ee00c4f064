"""auv_lse live: shows a running mission or a recording on one page in a browser on this machine."""

import argparse
import asyncio
import os
import sys
import threading
import webbrowser
from collections.abc import Callable
from pathlib import Path

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.support.atomic_files import write_whole
from auv_lse_common.support.ending_signals import accepted_signals
from auv_lse_record.recording import RecordingError, recording_in
from auv_lse_run.process.domain import DomainError, busy_domains, check_own, confine_to, domain_number
from auv_lse_run.process.interrupt import note_signal
from auv_lse_shore.live.sources.command_queue import CommandQueue
from auv_lse_shore.live.sources.follow import RecordingFollower
from auv_lse_shore.live.sources.timeline import Timeline
from auv_lse_shore.live.viewers.page import live_page
from auv_lse_shore.live.viewers.server import DEFAULT_PORT, LiveServer, PortTakenError

Work = Callable[[threading.Event], None]

_LAST_PORT = 65535


class LiveError(ValueError):
    """An option of auv_lse live has an invalid value."""


ERRORS = (DomainError, LiveError, ParameterError, RecordingError, PortTakenError)


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse live."""
    p = argparse.ArgumentParser(
        prog="auv_lse live",
        description="Shows a mission on one page in a browser on this machine: map with risk and isobath, tracks, "
        "plans, packets in their slots, reward and bound, health. See docs/guide/live-view.md.",
        epilog="Exit codes: 0 --write wrote the page; 2 wrong command line, or unusable RUN or port; "
        "130 Ctrl-C, which ends the server.",
    )
    p.add_argument(
        "run",
        nargs="?",
        type=Path,
        metavar="RUN",
        help="a run folder, a rosbag2 directory or an MCAP file, complete or still being written (default: the newest "
        "mission on this machine, or the next one to start)",
    )
    p.add_argument(
        "--domain",
        metavar="N",
        help="ROS domain of the mission (default: that of the newest; --control needs it if several run)",
    )
    p.add_argument("--mission", type=Path, metavar="FILE", help="mission file, if the recording has none")
    p.add_argument("--port", type=int, help=f"port on 127.0.0.1; 0: any free port (default: {DEFAULT_PORT})")
    p.add_argument(
        "--open",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="open the page in this machine's browser (default: --open; never with --control)",
    )
    p.add_argument(
        "--control",
        action="store_true",
        help="buttons to hold, surface or abort the vehicles, allowed by a token in the printed address",
    )
    p.add_argument(
        "--write", type=Path, metavar="FILE.html", help="write the page and the recording into one file and exit"
    )
    return p


def run(options: argparse.Namespace) -> int:
    """Serves the live view until Ctrl-C, or writes the page. Returns the exit code."""
    timeline, commands = Timeline(), CommandQueue() if options.control else None
    _check(options)
    if options.run is None:
        if options.write is not None:
            raise RecordingError("--write needs a recording: auv_lse live RUN --write FILE")
        work = listen_to_missions(timeline, options, commands)
    else:
        follower = RecordingFollower(recording_in(options.run), timeline, options.mission)
        if options.write is not None:
            return write_page(follower, timeline, options.write)
        work = follower.follow
    return asyncio.run(serve(timeline, work, options.port, options.open is not False, commands))


def _check(options: argparse.Namespace) -> None:
    """Checks options that the command line alone cannot."""
    if options.write is not None and (options.port is not None or options.open):
        name = "open" if options.open else "port"
        raise LiveError(f"--{name} serves a page, but --write only writes one. Leave out one of them")
    if options.port is None:
        options.port = DEFAULT_PORT
    if not 0 <= options.port <= _LAST_PORT:
        raise LiveError(f"--port must be 0 to {_LAST_PORT}, not {options.port}. Use 0 for any free port")
    if options.control and options.run is not None:
        raise LiveError(f"--control needs a running mission, but {options.run} is a recording. Leave out RUN")
    if options.domain is not None and options.run is not None:
        raise LiveError(f"--domain is for running missions, but {options.run} is a recording. Leave out one")
    if options.mission is not None and not options.mission.exists():
        raise LiveError(f"--mission {options.mission}: there is no such file")


def _only_domain() -> int | None:
    """The domain of the one mission on this machine, so that its buttons never reach another; None without one."""
    busy = busy_domains()
    if len(busy) > 1:
        raise DomainError(
            f"Several missions are running (domains {', '.join(map(str, busy))}); choose one with --domain"
        )
    if not busy:
        return None
    check_own(busy[0])
    return busy[0]


def listen_to_missions(timeline: Timeline, options: argparse.Namespace, commands: CommandQueue | None) -> Work:
    """Returns the function that fills the timeline from running missions.

    Raises:
        DomainError: if --domain is invalid, or as `confine_to`.
    """
    from auv_lse_shore.live.sources.running import MissionFollower

    domain = None if options.domain is None else domain_number(options.domain)
    if commands is not None and domain is None:
        domain = _only_domain()
    confine_to(domain or 0)
    return MissionFollower(timeline, domain, options.mission, commands).follow


def write_page(follower: RecordingFollower, timeline: Timeline, path: Path) -> int:
    """Writes the page with a whole recording into one file.

    Raises:
        LiveError: if the file cannot be written.
    """
    follower.read()
    _, _, events = timeline.since("", 0, sys.maxsize)
    try:
        write_whole(path, live_page(events))
    except OSError as error:
        raise LiveError(f"--write {path}: cannot be written: {error.strerror or error}. Choose another file") from error
    print(f"written: {path} ({path.stat().st_size / 1e6:.1f} MB; needs no server)")
    return 0


def has_screen() -> bool:
    """Whether a browser can open a window; without a display it might take over the terminal."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


async def serve(timeline: Timeline, work: Work, port: int, open_browser: bool, commands: CommandQueue | None) -> int:
    """Serves the page until Ctrl-C; `work` fills the timeline on a thread of its own.

    Raises:
        PortTakenError: if the port is in use.
    """
    server = LiveServer(timeline, port, commands)
    stop, ended = threading.Event(), asyncio.Event()

    def end(number: int) -> None:
        note_signal(number)
        ended.set()

    for number in accepted_signals():
        asyncio.get_running_loop().add_signal_handler(number, end, number)
    thread = threading.Thread(target=work, args=(stop,), daemon=True)
    thread.start()
    print(f"live view: {server.url}   (stop with Ctrl-C)", flush=True)
    # other users see a browser's command line, and a token in it
    if open_browser and has_screen() and commands is None:
        await asyncio.to_thread(webbrowser.open, server.url)
    await ended.wait()
    print("live view ended", flush=True)
    stop.set()
    await server.close()
    await asyncio.to_thread(thread.join, 5.0)
    return 130
