"""Sends a timeline to viewers as standard messages: live, or a recording played at a chosen rate."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Protocol

from auv_lse_shore.live.sources.timeline import Event, Timeline
from auv_lse_shore.live.viewers.standard_messages import StandardMessage, StandardMessages

_PERIOD_S = 0.1


class Viewer(Protocol):
    """A program that displays standard messages."""

    def begin(self, messages: StandardMessages, first_s: float, last_s: float) -> None:
        """Begins a mission; for a recording with its first and last time (s), else both are 0."""

    def show(self, message: StandardMessage) -> None:
        """Shows a message."""

    def close(self) -> None:
        """Closes the viewer."""


class Playback:
    """Position in a recording that is played: time, rate, paused or not. Any thread may change it."""

    def __init__(self, rate: float) -> None:
        """Starts at the beginning."""
        self.rate = rate
        self.playing = True
        self.t = 0.0
        self._sought: float | None = None

    def seek(self, t: float) -> None:
        """Jumps to a time (s)."""
        self._sought = t

    def step(self, elapsed_s: float, last_s: float) -> tuple[float, float, bool]:
        """Advances by seconds of wall clock.

        Returns:
            The interval (after, until] of mission time to show, and whether playback has jumped.
        """
        if self._sought is not None:
            self.t, self._sought = min(self._sought, last_s), None
            return -1e18, self.t, True
        before = self.t
        if self.playing:
            self.t = min(last_s, self.t + elapsed_s * self.rate)
        return before, self.t, False


class Feed:
    """Shows a timeline on viewers, on the thread that calls `run`."""

    def __init__(self, timeline: Timeline, viewers: Sequence[Viewer], playback: Playback) -> None:
        """Takes the timeline and its viewers."""
        self._timeline = timeline
        self._viewers = viewers
        self._playback = playback

    def run(self, stop: threading.Event) -> None:
        """Shows one mission after another until `stop` is set."""
        name, have = "", 0
        messages: StandardMessages | None = None
        try:
            while not stop.is_set():
                new, first, events = self._timeline.since(name, have, 1000)
                if new != name and events:
                    messages = StandardMessages(events[0])
                    if self._timeline.state.get("source") == "recording":
                        self._play(new, stop)
                        name, have = new, 10**9  # everything has been shown
                        continue
                    self._begin(messages, 0.0, 0.0)
                    self._show(messages.first(0.0))
                if new == name or events:
                    name, have = new, first + len(events)
                if messages is not None:
                    for event in events:
                        self._show(messages.take(event))
                if len(events) < 1000:
                    stop.wait(_PERIOD_S)
        finally:
            for viewer in self._viewers:
                viewer.close()

    def _play(self, name: str, stop: threading.Event) -> None:
        """Plays a recording, also while it grows, until another mission begins."""
        events: list[Event] = []
        messages: StandardMessages | None = None
        last_s, wall_s = 0.0, time.monotonic()
        while not stop.is_set():
            now, _, new = self._timeline.since(name, len(events) if events else 0, 10**6)
            if now != name:
                return
            if new:
                events = [*events, *new]
                last_s = max((e["t"] for e in events[1:]), default=0.0)
            if messages is None:
                messages = StandardMessages(events[0])
                self._begin(messages, min((e["t"] for e in events[1:]), default=0.0), last_s)
                self._show(messages.first(0.0))
            elapsed_s, wall_s = time.monotonic() - wall_s, time.monotonic()
            after, until, jumped = self._playback.step(elapsed_s, last_s)
            if jumped:
                messages = StandardMessages(events[0])
            due = [e for e in events[1:] if after < e["t"] <= until]
            shown = [m for e in sorted(due, key=lambda e: float(e["t"])) for m in messages.take(e)]
            if jumped:  # only the last message of each topic
                shown = [*messages.first(0.0), *{m.topic: m for m in shown}.values()]
            self._show(shown)
            stop.wait(_PERIOD_S)

    def _begin(self, messages: StandardMessages, first_s: float, last_s: float) -> None:
        for viewer in self._viewers:
            viewer.begin(messages, first_s, last_s)

    def _show(self, messages: Sequence[StandardMessage]) -> None:
        for message in messages:
            for viewer in self._viewers:
                viewer.show(message)
