"""scripts/live: a running mission, or a recording, on one page in a browser on this machine."""

from __future__ import annotations

import argparse
import asyncio
import signal
import sys
import threading
import webbrowser
from collections.abc import Callable, Sequence
from pathlib import Path

from auv_lse_common.params import ParameterError
from auv_lse_common.recording import RecordingError, recording_in
from auv_lse_sim.live.follow import RecordingFollower
from auv_lse_sim.live.page import live_page
from auv_lse_sim.live.server import LiveServer, PortTakenError
from auv_lse_sim.live.timeline import Timeline

DEFAULT_PORT = 8642

Work = Callable[[threading.Event], None]


def parser() -> argparse.ArgumentParser:
    """The command line of scripts/live."""
    p = argparse.ArgumentParser(
        prog="scripts/live",
        description="Shows a mission on one page in a browser on this machine: map with risk and isobath, tracks, "
        "plans, packets in their slots, reward and bound, health. See docs/live.md.",
    )
    p.add_argument(
        "run",
        nargs="?",
        type=Path,
        metavar="RUN",
        help="a run folder, a rosbag2 directory or an MCAP file, complete or still being written",
    )
    p.add_argument("--mission", type=Path, metavar="FILE", help="mission file, if there is none beside the recording")
    p.add_argument(
        "--port", type=int, default=DEFAULT_PORT, help=f"port on 127.0.0.1, 0: any (default: {DEFAULT_PORT})"
    )
    p.add_argument(
        "--open",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="open the page in this machine's browser (default: --open)",
    )
    p.add_argument(
        "--write", type=Path, metavar="FILE.html", help="write the page with the recording inside, and serve nothing"
    )
    return p


def main(arguments: Sequence[str] | None = None) -> int:
    """Serves the live view. Returns 0, 1 if it failed, 2 if the request cannot be met, 130 after Ctrl-C."""
    options = parser().parse_args(arguments)
    timeline = Timeline()
    try:
        if options.run is None:
            raise RecordingError("RUN: missing; expected a run folder, a rosbag2 directory or an MCAP file")
        follower = RecordingFollower(recording_in(options.run), timeline, options.mission)
        if options.write is not None:
            return write_page(follower, timeline, options.write)
        return asyncio.run(serve(timeline, follower.follow, options.port, options.open))
    except (ParameterError, RecordingError, PortTakenError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def write_page(follower: RecordingFollower, timeline: Timeline, path: Path) -> int:
    """Writes the page with a whole recording inside of it."""
    follower.read()
    _, _, events = timeline.since("", 0, sys.maxsize)
    path.write_text(live_page(events))
    print(f"written: {path} ({path.stat().st_size / 1e6:.1f} MB; needs no server)")
    return 0


async def serve(timeline: Timeline, work: Work, port: int, open_browser: bool) -> int:
    """Serves the page until Ctrl-C, while `work` fills the timeline on a thread of its own.

    Raises:
        PortTakenError: if the port is in use.
    """
    server = LiveServer(timeline, port)
    stop, ended = threading.Event(), asyncio.Event()
    loop = asyncio.get_running_loop()
    for sign in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(sign, ended.set)
    thread = threading.Thread(target=work, args=(stop,), name="source", daemon=True)
    thread.start()
    print(f"live view: {server.url}   (Ctrl-C ends it)", flush=True)
    if open_browser:
        await asyncio.to_thread(webbrowser.open, server.url)
    await ended.wait()
    stop.set()
    await server.close()
    await asyncio.to_thread(thread.join, 5.0)
    return 130
