"""Plays a recording into the ROS domain of the environment again and again, with every command, as `ros2 bag play`."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import rclpy
from rclpy.signals import SignalHandlerOptions

from auv_lse_common.topics.ros_conversions import message_class
from auv_lse_record.recording import Recording
from auv_lse_shore.replay.player_node import quality_of

_PERIOD_S = 0.002


def main() -> None:
    """Plays the recording that the command line names until SIGTERM."""
    with Recording(Path(sys.argv[1])) as recording:
        topics = {name: topic for name, topic in recording.topics.items() if name.startswith(("/auv", "/sim"))}
        messages = [(topic, data) for topic, _, data in recording.raw(topics)]
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("stray_player")
    publishers = {
        name: node.create_publisher(message_class(topic.kind), name, quality_of(topic))
        for name, topic in topics.items()
    }
    while True:
        for topic, data in messages:
            publishers[topic].publish(data)
            time.sleep(_PERIOD_S)


if __name__ == "__main__":
    main()
