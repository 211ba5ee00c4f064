"""Heights of a DVL, with a stand-in for `marine_acoustic_msgs`: the fields of its published Dvl.msg."""

import math
import sys
from types import ModuleType, SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.vocabulary.sounding import Sounding
from auv_lse_mavlink.dvl_node import altitude_of, listen_to_dvl
from auv_lse_mavlink.messages.events import AutopilotEstimate
from auv_lse_mavlink.port import AutopilotPort

pytestmark = pytest.mark.ros


class Dvl:
    """The fields of the message that the stack reads."""

    DVL_MODE_BOTTOM, DVL_MODE_WATER = 1, 2

    def __init__(self, stamp_s=0.0, altitude=12.5, beams=4, mode=DVL_MODE_BOTTOM):
        sec = int(stamp_s)
        self.header = SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=round(1e9 * (stamp_s - sec))))
        self.altitude, self.num_good_beams, self.velocity_mode = altitude, beams, mode


def test_height_and_stamp_are_the_messages():
    found = altitude_of(Dvl(1700000000.25, 12.5, beams=3))
    assert (found.stamp_s, found.altitude_m) == (1700000000.25, 12.5)


@pytest.mark.parametrize(
    "message",
    [Dvl(beams=2), Dvl(mode=Dvl.DVL_MODE_WATER), Dvl(altitude=0.0), Dvl(altitude=-1.0), Dvl(altitude=math.nan)],
)
def test_without_the_ground_in_sight_there_is_no_height(message):
    assert math.isnan(altitude_of(message).altitude_m)


def test_messages_on_the_topic_are_taken(monkeypatch):
    package = ModuleType("marine_acoustic_msgs.msg")
    package.Dvl = Dvl
    monkeypatch.setitem(sys.modules, "marine_acoustic_msgs", ModuleType("marine_acoustic_msgs"))
    monkeypatch.setitem(sys.modules, "marine_acoustic_msgs.msg", package)
    subscribed, taken = [], []
    assert listen_to_dvl(SimpleNamespace(create_subscription=lambda *given: subscribed.append(given)), taken.append)
    ((kind, topic, receive, _),) = subscribed
    assert (kind, topic) == (Dvl, "dvl")
    receive(Dvl(altitude=7.0))
    assert [altitude.altitude_m for altitude in taken] == [7.0]


def test_without_the_message_package_nothing_is_subscribed_to(monkeypatch):
    monkeypatch.setitem(sys.modules, "marine_acoustic_msgs", None)
    monkeypatch.setitem(sys.modules, "marine_acoustic_msgs.msg", None)
    assert not listen_to_dvl(SimpleNamespace(), lambda altitude: None)


def test_heights_become_soundings(monkeypatch):
    port = AutopilotPort(LinkConfig(kind="mavlink", endpoint="udpin://127.0.0.1:0"), 1, None)
    monkeypatch.setattr(type(port.link), "report", SimpleNamespace(depth_problem=""))
    monkeypatch.setattr(type(port.link.gauge), "is_known", True)
    soundings = []
    for tenth in range(100):
        stamp_s = tenth / 10.0
        port.link.take_altitude("topic dvl", altitude_of(Dvl(stamp_s, 12.5)))
        estimate = AutopilotEstimate(
            stamp_s=stamp_s,
            heading_rad=0.0,
            north_m=stamp_s,
            east_m=0.0,
            depth_m=3.0,
            speed_mps=1.0,
            yaw_rate_radps=0.0,
        )
        port.link._report_event(estimate)
        soundings += [event for event in port._events() if isinstance(event, Sounding)]
    assert soundings
    assert {sounding.depth_m for sounding in soundings} == {15.5}
