"""Recordings of version 0.2, whose frames began with the id of the dive, are played as this version publishes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from auv_lse_record.bag_writer import BagWriter
from auv_lse_record.earlier_versions import Translator
from auv_lse_record.message_types import definitions, dive_in, make_message, message_folder, project_types, types_of
from auv_lse_record.recording import Recording

DIVE = "sim-1123-184534-3f2a"
SOUNDING, CENTERS, ODOMETRY = "auv_lse_msgs/msg/Sounding", "auv_lse_msgs/msg/KernelCenters", "nav_msgs/msg/Odometry"


def test_messages_of_an_earlier_version_are_translated(tmp_path: Path) -> None:
    texts = definitions([message_folder()], "auv_lse_msgs")
    for kind, text in texts.items():
        lines = [line for line in text.splitlines() if not line.startswith("string dive ")]
        texts[kind] = "\n".join(lines).replace("position_", "place_") + "\n"
    earlier, present = types_of(texts), project_types()
    header = {"stamp": {"sec": 3, "nanosec": 5}, "frame_id": f"{DIVE}/map"}
    values = {
        "/auv2/sounding": (SOUNDING, {"header": header, "depth_m": 12.5}),
        "/auv2/kernel_centers": (CENTERS, {"header": header, "north_m": np.array([1.0, 2.0]), "place_modes": 3}),
        "/auv2/odometry": (ODOMETRY, {"header": header, "child_frame_id": "auv2", "pose": {"covariance": np.ones(36)}}),
    }
    bag = BagWriter(tmp_path / "bag", earlier, {})
    for number, (topic, (kind, fields)) in enumerate(values.items()):
        bag.add_topic(topic, kind)
        bag.write(topic, number, bytes(earlier.serialize_cdr(make_message(earlier, kind, fields), kind)))
    bag.close()
    with Recording(tmp_path / "bag") as recording:
        found = {topic: data for topic, _, data in recording.translated(values)}
    sounding, centers, odometry = (present.deserialize_cdr(found[t], kind) for t, (kind, _) in values.items())
    assert {m.header.frame_id for m in (sounding, centers, odometry)} == {"map"}
    assert (sounding.dive, sounding.depth_m, sounding.header.stamp.nanosec) == (DIVE, 12.5, 5)
    assert (centers.dive, list(centers.north_m), centers.position_modes) == (DIVE, [1.0, 2.0], 3)
    assert (odometry.child_frame_id, odometry.pose.covariance.sum()) == ("auv2/base_link", 36.0)
    again = Translator(present, present)
    assert all(again.translated(kind, found[topic]) is found[topic] for topic, (kind, _) in values.items())
    assert dive_in(found["/auv2/sounding"]) == DIVE
