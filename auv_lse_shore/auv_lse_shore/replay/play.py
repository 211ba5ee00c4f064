"""Plays a recording for any viewer, and shows its progress on the terminal."""

import math
import sys
import time
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager

from auv_lse_common.support.confinement import confine, watch_variables
from auv_lse_record.recording import Recording, RecordingError, recording_in
from auv_lse_run.mission.display import clock
from auv_lse_run.process.domain import simulator_domain
from auv_lse_shore.replay.keys import HELP, Keys
from auv_lse_shore.replay.pace import Selection, select_topics
from auv_lse_shore.replay.player_node import Player, Progress
from auv_lse_shore.report.progress import can_rewrite

#: Seconds between two lines of progress: in a terminal (one line, rewritten), elsewhere.
_REWRITE_S, _LINE_S = 0.2, 10.0


class ReplayError(ValueError):
    """Options that do not fit the recording."""


def play(options: Namespace) -> int:
    """Plays `options.run` (see `options.py`). Returns 0.

    Raises:
        RecordingError: if the recording cannot be read.
        ReplayError: if the options do not fit the recording.
    """
    if not 0.0 < options.rate < math.inf:
        raise ReplayError(f"--rate must be a finite number above 0, not {options.rate:g}")
    if options.duration is not None and not options.duration > 0.0:
        raise ReplayError(f"--duration must be more than 0 s, not {options.duration:g}")
    with Recording(recording_in(options.run)) as recording:
        length_s = (recording.end_ns - recording.start_ns) * 1e-9
        if not recording.topics or not recording.end_ns:
            raise RecordingError(f"{options.run} holds no message; nothing to play")
        if not 0.0 <= options.start <= length_s:
            raise ReplayError(f"--start must be within the recording, 0 to {length_s:.1f} s, not {options.start:g}")
        chosen = select_topics(recording.topics, options.topics, options.commands)
        if chosen.unknown:
            there = ", ".join(sorted(recording.topics))
            raise ReplayError(f"--topics: the recording has no {' '.join(chosen.unknown)}; it has {there}")
        start_ns = recording.start_ns + round(options.start * 1e9)
        stop_ns = recording.end_ns + 1
        if options.duration is not None:
            stop_ns = min(stop_ns, start_ns + round(options.duration * 1e9))
        with _domain(options.domain), Keys() as keys, Player(recording, chosen.played, keys) as player:
            _announce(chosen, player.missing, keys.available)
            line = _Line(length_s)
            again = True
            while again:
                line.end(player.play(start_ns, stop_ns, options.rate, options.paused, line.show))
                again = options.loop
    return 0


@contextmanager
def _domain(wanted: str | None) -> Iterator[None]:
    """Reserves the wanted ROS domain, or a free one."""
    with simulator_domain(wanted) as domain:
        confine(domain)
        print(f"to watch from another terminal: export {watch_variables(domain)}", flush=True)
        yield


def _announce(chosen: Selection, missing: dict[str, str], keys: bool) -> None:
    if chosen.commands:
        print(f"left out, as vehicles and modems act on them: {', '.join(chosen.commands)} (--commands plays them)")
    for topic, kind in missing.items():
        print(f"left out: {topic}: its type {kind} is not installed here")
    if keys:
        print(HELP)
    sys.stdout.flush()


class _Line:
    """The progress line."""

    def __init__(self, length_s: float) -> None:
        self._length_s = length_s
        self._terminal = can_rewrite(sys.stdout)
        self._shown_s = -float("inf")

    def show(self, progress: Progress) -> None:
        """Shows the progress, at most every few tenths of a second."""
        now_s = time.monotonic()
        if now_s - self._shown_s >= (_REWRITE_S if self._terminal else _LINE_S):
            self._shown_s = now_s
            print(self._text(progress), end="\x1b[K\r" if self._terminal else "\n", flush=True)

    def end(self, progress: Progress) -> None:
        """Shows the last line of a round."""
        print(self._text(progress), end="\x1b[K\n" if self._terminal else "\n", flush=True)

    def _text(self, p: Progress) -> str:
        state = "pause  " if p.paused else "playing"
        return f"{state} {clock(p.at_s)} of {clock(self._length_s)}  x {p.rate:.3g}  {p.messages} messages"
