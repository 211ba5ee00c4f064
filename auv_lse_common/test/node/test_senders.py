"""Messages of standard types are traced to the dive of the participant that has sent them."""

from __future__ import annotations

import time
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

import rclpy
from nav_msgs.msg import Odometry
from rclpy.context import Context

from auv_lse_common.node import senders as module
from auv_lse_common.node.executor import StandingExecutor
from auv_lse_common.node.senders import _PATIENCE_S, _REMEMBERED, Senders, take_with_sender
from auv_lse_common.topics.quality import EVERY, LATCHED, LATCHED_READER
from auv_lse_msgs.msg import Dive

pytestmark = pytest.mark.ros
OWN, OTHER = "auv1-1123-184534-3f2a", "sim-1123-184534-3f2a"


def test_a_participant_without_an_introduction_is_a_users_driver_after_a_while():
    senders = Senders(OWN)
    assert senders.sender_of("map", b"a", 0.0) is None, "it may still introduce itself"
    assert senders.sender_of("map", b"a", _PATIENCE_S) == ""
    senders.introduce(SimpleNamespace(dive=OTHER, node="sim_node"), b"a")
    senders.introduce(SimpleNamespace(dive=OWN, node="gp_node"), b"b")
    assert [senders.sender_of("map", name, 9.0) for name in (b"a", b"b")] == [OTHER, OWN]
    assert senders.nodes == {"gp_node"}
    assert senders.sender_of("map", None, 9.0) == OWN, "rclpy's own executor names nobody"
    assert senders.sender_of(f"{OTHER}/map", b"b", 9.0) == OTHER, "a recording of version 0.2"


def test_a_flood_of_participants_is_forgotten():
    senders = Senders(OWN)
    for number in range(2 * _REMEMBERED):
        senders.introduce(SimpleNamespace(dive=OTHER, node="sim_node"), number.to_bytes(12, "big"))
        senders.sender_of("map", (1 << 64 | number).to_bytes(12, "big"), 0.0)
    assert len(senders._dives) == len(senders._heard_s) == _REMEMBERED


def test_another_middleware_than_fast_dds_names_no_participant(monkeypatch):
    monkeypatch.setattr(module, "get_rmw_implementation_identifier", lambda: "rmw_cyclonedds_cpp")
    assert not hasattr(take_with_sender(SimpleNamespace()), "take"), "its ids of writers share no part"


def test_where_rcl_cannot_be_called_messages_come_without_their_participant(monkeypatch):
    def no_library(name):
        raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(module.ctypes, "CDLL", no_library)
    module._rcl.cache_clear()
    try:
        assert not hasattr(take_with_sender(SimpleNamespace()), "take")
    finally:
        module._rcl.cache_clear()


def test_two_participants_on_one_topic_are_told_apart():
    rclpy.init()
    contexts = [Context(), Context()]
    for context in contexts:
        rclpy.init(context=context)
    reader, writers = rclpy.create_node("reader"), [rclpy.create_node("writer", context=c) for c in contexts]
    senders, found = Senders(OWN), {}
    executor = StandingExecutor()
    executor.add_node(reader)

    def receive(message, participant):
        if (sender := senders.sender_of(message.header.frame_id, participant, 0.0)) is not None:
            found.setdefault(message.child_frame_id, set()).add(sender)

    take_with_sender(reader.create_subscription(Dive, "dive", senders.introduce, LATCHED_READER))
    take_with_sender(reader.create_subscription(Odometry, "odometry", receive, EVERY))
    try:
        publishers = []
        for dive, writer in zip((OWN, OTHER), writers, strict=True):
            publishers.append((dive, writer.create_publisher(Odometry, "odometry", EVERY)))
            writer.create_publisher(Dive, "dive", LATCHED).publish(Dive(dive=dive, node="sim_node"))
        until = time.monotonic() + 20.0
        while found != {OWN: {OWN}, OTHER: {OTHER}}:
            assert time.monotonic() < until, found
            for dive, publisher in publishers:
                publisher.publish(Odometry(child_frame_id=dive))
            executor.spin_once(timeout_sec=0.05)
    finally:
        executor.shutdown()
        for node in (reader, *writers):
            node.destroy_node()
        for context in contexts:
            rclpy.shutdown(context=context)
        rclpy.try_shutdown()
