"""Publishes a recording's serialized messages at their times, with their recorded quality of service."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock

from auv_lse_common.support.ros_logs import init_arguments
from auv_lse_common.topics.quality import EVERY
from auv_lse_common.topics.ros_conversions import message_class, stamp
from auv_lse_record.recording import RecordedTopic, Recording
from auv_lse_shore.replay.keys import Keys
from auv_lse_shore.replay.pace import CLOCK, RATE_STEP, Pace, last_of_each

#: Period (s of wall clock) for reading keys, and for clock messages if the recording has none.
_PERIOD_S = 0.025


@dataclass(slots=True)
class Progress:
    """Progress of a replay.

    Attributes:
        at_s: Seconds since the recording's first message.
        rate: Seconds of the recording per second of wall clock.
        messages: Number of messages published.
    """

    at_s: float
    rate: float
    paused: bool
    messages: int = 0


def quality_of(topic: RecordedTopic) -> QoSProfile:
    """The quality of service that a topic was recorded with."""
    return QoSProfile(
        depth=topic.depth,
        reliability=ReliabilityPolicy.RELIABLE if topic.reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE,
    )


class Player:
    """The publishing node; a context manager.

    Attributes:
        missing: Topics whose message types are not installed, {topic: type}.
    """

    def __init__(self, recording: Recording, topics: tuple[RecordedTopic, ...], keys: Keys) -> None:
        """Does not join a ROS domain yet."""
        self.missing: dict[str, str] = {}
        self.progress = Progress(0.0, 1.0, False)
        self._recording, self._topics, self._keys = recording, topics, keys
        self._shown_s = -float("inf")
        self._steps = 0  # messages asked for in a pause

    def __enter__(self) -> Player:
        """Joins the ROS domain with a publisher for each topic; leaves Ctrl-C to the caller."""
        rclpy.init(args=init_arguments(), signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("replay")
        self._publishers = {}
        for topic in self._topics:
            try:
                kind = message_class(topic.kind)
            except (ImportError, AttributeError):
                self.missing[topic.name] = topic.kind
                continue
            self._publishers[topic.name] = self._node.create_publisher(kind, topic.name, quality_of(topic))
        self._clock = None if CLOCK in self._publishers else self._node.create_publisher(Clock, CLOCK, EVERY)
        return self

    def __exit__(self, *_: object) -> None:
        """Leaves the ROS domain."""
        self._node.destroy_node()
        rclpy.try_shutdown()

    def play(
        self, start_ns: int, stop_ns: int, rate: float, paused: bool, show: Callable[[Progress], None]
    ) -> Progress:
        """Plays once.

        Args:
            start_ns: Stamp to start at; earlier latched messages are published first.
            stop_ns: Stamp to stop before.
            rate: Seconds of the recording per second of wall clock.
            paused: Whether it starts paused.
            show: Called several times a second.
        """
        pace = Pace(start_ns, rate, time.monotonic(), paused)
        self.progress = progress = Progress((start_ns - self._recording.start_ns) * 1e-9, rate, paused)
        latched = [topic.name for topic in self._topics if topic.latched and topic.name in self._publishers]
        for topic, _, data in last_of_each(self._recording.translated(latched, stop_ns=start_ns)):
            self._publishers[topic].publish(data)
        for topic, stamp_ns, data in self._recording.translated(self._publishers, start_ns, stop_ns):
            self._wait_for(stamp_ns, pace, progress, show)
            self._publishers[topic].publish(data)
            progress.messages += 1
        self._wait_for(stop_ns, pace, progress, show)
        return progress

    def _wait_for(self, stamp_ns: int, pace: Pace, progress: Progress, show: Callable[[Progress], None]) -> None:
        self._show(stamp_ns, pace, progress, show)
        while (wait_s := pace.wait_s(stamp_ns, time.monotonic())) > 0.0:
            keys = self._keys.wait(min(wait_s, _PERIOD_S))
            wall_s = time.monotonic()
            for key in keys:
                match key:
                    case "pause":
                        pace.toggle(wall_s)
                    case "faster":
                        pace.change_rate(RATE_STEP, wall_s)
                    case "slower":
                        pace.change_rate(1.0 / RATE_STEP, wall_s)
            self._steps += keys.count("next")
            if not pace.paused:
                self._steps = 0
            self._show(stamp_ns, pace, progress, show)
            if self._steps:  # in a pause, each press is one message, also of several with one stamp
                self._steps -= 1
                pace.step_to(stamp_ns, wall_s)
                return

    def _show(self, next_ns: int, pace: Pace, progress: Progress, show: Callable[[Progress], None]) -> None:
        """At most every `_PERIOD_S`: publishes the clock if the recording has none, and shows the progress.

        A rate that this machine cannot reach takes the time to the next message, at `next_ns`, but not beyond it.
        """
        wall_s = time.monotonic()
        if wall_s - self._shown_s < _PERIOD_S:
            return
        self._shown_s = wall_s
        now_ns = min(pace.now_ns(wall_s), next_ns)
        progress.at_s = (now_ns - self._recording.start_ns) * 1e-9
        progress.rate, progress.paused = pace.rate, pace.paused
        if self._clock is not None:
            self._clock.publish(Clock(clock=stamp(now_ns * 1e-9)))
        show(progress)
