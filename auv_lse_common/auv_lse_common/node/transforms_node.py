"""A vehicle's transforms by REP 105, published on /tf where `tf2_msgs` is installed (it is not on PyPI).

    map -> auvN/odom        jumps at a fix: the drift of dead reckoning
    auvN/odom -> auvN/base_link   never jumps: dead reckoning since the start
    auvN/base_link -> auvN/dvl    fixed: x points down, so that RViz draws the altitude's range

Frames are ENU, z up. No node of the stack reads them; they serve RViz and other packages, and are published only where
they have readers.
"""

from __future__ import annotations

import importlib
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from auv_lse_common.topics.codecs import base_frame, odom_frame, sonar_frame
from auv_lse_common.topics.ros_conversions import stamp
from auv_lse_common.vocabulary.frames import wrap_pi, yaw_from_heading

if TYPE_CHECKING:
    from rclpy.node import Node

#: The message package, by name: a vehicle without it works, but publishes no transforms.
_PACKAGE = "tf2_msgs.msg"


@dataclass(frozen=True, slots=True, kw_only=True)
class Transform:
    """Pose of the frame `child` in `parent`.

    Attributes:
        parent, child: Frames.
        xyz_m: Position: x, y, z.
        yaw_rad: Rotation about z, counter-clockwise.
        pitch_rad: Rotation about y, before that about z; positive: x turns down.
    """

    parent: str
    child: str
    xyz_m: tuple[float, float, float]
    yaw_rad: float = 0.0
    pitch_rad: float = 0.0


def transforms(vehicle: int, odometry: Any, raw: Any) -> tuple[Transform, Transform, Transform]:
    """The transforms map -> odom, odom -> base_link and base_link -> dvl of a vehicle.

    Args:
        odometry: Its navigation's estimate, with `heading_rad`, `north_m`, `east_m`.
        raw: Its dead-reckoned position at the same time (`DeadReckoning`).
    """
    odom, base = odom_frame(vehicle), base_frame(vehicle)
    yaw_rad = yaw_from_heading(raw.heading_rad)
    turn_rad = float(wrap_pi(yaw_from_heading(odometry.heading_rad) - yaw_rad))
    cos, sin = math.cos(turn_rad), math.sin(turn_rad)
    drift_x_m = odometry.east_m - (cos * raw.east_m - sin * raw.north_m)
    drift_y_m = odometry.north_m - (sin * raw.east_m + cos * raw.north_m)
    return (
        Transform(parent="map", child=odom, xyz_m=(drift_x_m, drift_y_m, 0.0), yaw_rad=turn_rad),
        Transform(
            parent=odom,
            child=base,
            xyz_m=(raw.east_m, raw.north_m, -raw.depth_m),
            yaw_rad=yaw_rad,
        ),
        Transform(parent=base, child=sonar_frame(vehicle), xyz_m=(0.0, 0.0, 0.0), pitch_rad=math.pi / 2.0),
    )


class TransformPublisher:
    """Publishes the transforms of one vehicle on /tf; does nothing without `tf2_msgs`."""

    def __init__(self, node: Node, vehicle: int) -> None:
        """Creates the publisher on `node`."""
        self._vehicle = vehicle
        self._publisher = None
        try:
            self._type = importlib.import_module(_PACKAGE).TFMessage
        except ImportError:
            return
        self._publisher = node.create_publisher(self._type, "/tf", 100)

    def publish(self, odometry: Any, raw: Any) -> None:
        """Publishes the transforms; arguments as those of `transforms`. Positions that are not finite are left out."""
        if self._publisher is None or not self._publisher.get_subscription_count():
            return
        numbers = (odometry.heading_rad, odometry.north_m, odometry.east_m, raw.north_m, raw.east_m, raw.depth_m)
        if all(map(math.isfinite, numbers)):
            stamped = [_message(raw.stamp_s, each) for each in transforms(self._vehicle, odometry, raw)]
            self._publisher.publish(self._type(transforms=stamped))


def _message(stamp_s: float, transform: Transform) -> Any:
    from geometry_msgs.msg import TransformStamped

    message = TransformStamped(child_frame_id=transform.child)
    message.header.frame_id = transform.parent
    message.header.stamp = stamp(stamp_s)
    x, y, z = transform.xyz_m
    message.transform.translation.x, message.transform.translation.y, message.transform.translation.z = x, y, z
    half_yaw_rad, half_pitch_rad = transform.yaw_rad / 2.0, transform.pitch_rad / 2.0
    rotation = message.transform.rotation
    rotation.x = -math.sin(half_yaw_rad) * math.sin(half_pitch_rad)
    rotation.y = math.cos(half_yaw_rad) * math.sin(half_pitch_rad)
    rotation.z = math.sin(half_yaw_rad) * math.cos(half_pitch_rad)
    rotation.w = math.cos(half_yaw_rad) * math.cos(half_pitch_rad)
    return message
