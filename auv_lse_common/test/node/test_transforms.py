"""Transforms by REP 105: map -> odom -> base_link."""

import math
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from auv_lse_common.node.transforms_node import TransformPublisher, transforms
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning

pytestmark = pytest.mark.ros


def pose(transform):
    """Homogeneous matrix (3, 3) of a transform in the plane."""
    cos, sin = math.cos(transform.yaw_rad), math.sin(transform.yaw_rad)
    return np.array([[cos, -sin, transform.xyz_m[0]], [sin, cos, transform.xyz_m[1]], [0.0, 0.0, 1.0]])


def raw_at(heading_rad, north_m, east_m, depth_m=4.0):
    return DeadReckoning(stamp_s=12.25, heading_rad=heading_rad, north_m=north_m, east_m=east_m, depth_m=depth_m)


def test_together_they_are_the_position_of_navigation():
    rng = np.random.default_rng(1)
    for _ in range(50):
        heading, raw_heading = rng.uniform(-math.pi, math.pi, 2)
        north, east, raw_north, raw_east = rng.uniform(-500.0, 500.0, 4)
        odometry = SimpleNamespace(heading_rad=heading, north_m=north, east_m=east)
        to_odom, to_base = transforms(2, odometry, raw_at(raw_heading, raw_north, raw_east))
        base = pose(to_odom) @ pose(to_base)
        assert base[:2, 2] == pytest.approx([east, north], abs=1e-9)
        assert base[:2, 0] == pytest.approx([math.sin(heading), math.cos(heading)], abs=1e-9)  # forward, ENU
        assert (to_odom.parent, to_odom.child, to_base.child) == ("map", "auv2/odom", "auv2/base_link")
        assert to_base.xyz_m[2] == -4.0


@pytest.fixture
def sent(monkeypatch):
    """Messages published on /tf, with a stand-in for `tf2_msgs`."""
    package = ModuleType("tf2_msgs.msg")
    package.TFMessage = SimpleNamespace
    monkeypatch.setitem(sys.modules, "tf2_msgs", ModuleType("tf2_msgs"))
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", package)
    return []


def node(sent):
    return SimpleNamespace(create_publisher=lambda kind, name, depth: SimpleNamespace(publish=sent.append))


def test_messages_have_frames_and_stamps(sent):
    odometry = SimpleNamespace(heading_rad=0.0, north_m=10.0, east_m=20.0)
    TransformPublisher(node(sent), 1).publish(odometry, raw_at(0.0, 9.0, 18.0))
    (message,) = sent
    first, second = message.transforms
    assert (first.header.frame_id, first.child_frame_id) == ("map", "auv1/odom")
    assert (first.transform.translation.x, first.transform.translation.y) == (2.0, 1.0)
    assert (second.header.stamp.sec, second.header.stamp.nanosec) == (12, 250000000)
    assert second.transform.rotation.z == pytest.approx(math.sin(math.pi / 4.0))  # north is a yaw of 90 deg


def test_a_position_that_is_not_finite_is_left_out(sent):
    odometry = SimpleNamespace(heading_rad=0.0, north_m=math.nan, east_m=20.0)
    TransformPublisher(node(sent), 1).publish(odometry, raw_at(0.0, 9.0, 18.0))
    assert sent == []


def test_without_the_message_package_nothing_is_published(monkeypatch):
    monkeypatch.setitem(sys.modules, "tf2_msgs", None)
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", None)
    publisher = TransformPublisher(SimpleNamespace(), 1)
    publisher.publish(SimpleNamespace(heading_rad=0.0, north_m=0.0, east_m=0.0), raw_at(0.0, 0.0, 0.0))
