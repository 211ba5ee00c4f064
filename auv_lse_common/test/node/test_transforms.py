"""Transforms by REP 105: map -> odom -> base_link."""

import math
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from auv_lse_common.node.transforms_node import TransformPublisher
from auv_lse_common.topics.records import Altitude, Odometry
from auv_lse_common.topics.ros_conversions import encoded
from auv_lse_common.topics.table import VEHICLE_TOPICS
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning

pytestmark = pytest.mark.ros


def matrix_of(translation, q):
    """Homogeneous matrix (4, 4) of a translation and a quaternion, as tf2 composes them."""
    x, y, z, w = q.x, q.y, q.z, q.w
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = translation.x, translation.y, translation.z
    return matrix


def lookup(messages, target, source):
    """The pose of the frame `source` in `target`: what tf2's lookup_transform(target, source) returns."""
    parents = {m.child_frame_id: m for m in messages}
    matrix = np.eye(4)
    while source != target:
        m = parents[source]
        matrix = matrix_of(m.transform.translation, m.transform.rotation) @ matrix
        source = m.header.frame_id
    return matrix


def raw_at(heading_rad, north_m, east_m, depth_m=4.0):
    return DeadReckoning(stamp_s=12.25, heading_rad=heading_rad, north_m=north_m, east_m=east_m, depth_m=depth_m)


def test_transforms_agree_with_odometry_dead_reckoning_and_range_by_rep_103_and_105(sent):
    rng = np.random.default_rng(1)
    for _ in range(20):
        heading, raw_heading = rng.uniform(-math.pi, math.pi, 2)
        north, east, raw_north, raw_east = rng.uniform(-500.0, 500.0, 4)
        navigated = Odometry(stamp_s=12.25, heading_rad=heading, north_m=north, east_m=east, depth_m=4.0)
        raw = raw_at(raw_heading, raw_north, raw_east)
        TransformPublisher(node(sent), 2).publish(navigated, raw)
        tf = sent.pop().transforms
        for name, value in (("odometry", navigated), ("dead_reckoning", raw)):
            message = encoded(VEHICLE_TOPICS[name], value, 2)
            pose = message.pose.pose
            found = lookup(tf, message.header.frame_id, message.child_frame_id)
            assert found == pytest.approx(matrix_of(pose.position, pose.orientation), abs=1e-9), name
        base = lookup(tf, "map", "auv2/base_link")
        assert base[:3, 0] == pytest.approx([math.sin(heading), math.cos(heading), 0.0], abs=1e-9), "x forward, ENU"
        assert base[:3, 1] == pytest.approx([-math.cos(heading), math.sin(heading), 0.0], abs=1e-9), "y to port"
        altitude = encoded(VEHICLE_TOPICS["altitude"], Altitude(stamp_s=12.25, altitude_m=7.5), 2)
        ground = lookup(tf, "map", altitude.header.frame_id) @ [altitude.range, 0.0, 0.0, 1.0]
        assert ground[:3] == pytest.approx([east, north, -11.5], abs=1e-9), "4 m deep, 7.5 m above the ground"


def test_frames_are_those_of_rep_105():
    raw = raw_at(0.0, 1.0, 2.0)
    frames = {
        name: (message.header.frame_id, message.child_frame_id)
        for name in ("odometry", "dead_reckoning")
        for message in [encoded(VEHICLE_TOPICS[name], raw, 2)]
    }
    assert frames == {"odometry": ("map", "auv2/base_link"), "dead_reckoning": ("auv2/odom", "auv2/base_link")}


@pytest.fixture
def sent(monkeypatch):
    """Messages published on /tf, with a stand-in for `tf2_msgs`."""
    package = ModuleType("tf2_msgs.msg")
    package.TFMessage = SimpleNamespace
    monkeypatch.setitem(sys.modules, "tf2_msgs", ModuleType("tf2_msgs"))
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", package)
    return []


def node(sent, readers=1):
    publisher = SimpleNamespace(publish=sent.append, get_subscription_count=lambda: readers)
    return SimpleNamespace(create_publisher=lambda kind, name, depth: publisher)


def test_nothing_is_published_where_nobody_reads(sent):
    odometry = SimpleNamespace(heading_rad=0.0, north_m=10.0, east_m=20.0)
    for readers in (0, 1):
        TransformPublisher(node(sent, readers), 1).publish(odometry, raw_at(0.0, 9.0, 18.0))
        assert len(sent) == readers
    assert sent[0].transforms[0].header.stamp.sec == 12


def test_a_position_that_is_not_finite_is_left_out(sent):
    odometry = SimpleNamespace(heading_rad=0.0, north_m=math.nan, east_m=20.0)
    TransformPublisher(node(sent), 1).publish(odometry, raw_at(0.0, 9.0, 18.0))
    assert sent == []


def test_without_the_message_package_nothing_is_published(monkeypatch):
    monkeypatch.setitem(sys.modules, "tf2_msgs", None)
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", None)
    publisher = TransformPublisher(SimpleNamespace(), 1)
    publisher.publish(SimpleNamespace(heading_rad=0.0, north_m=0.0, east_m=0.0), raw_at(0.0, 0.0, 0.0))
