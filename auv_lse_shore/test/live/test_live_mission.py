"""The live view of a running mission: joins its ROS domain when it runs, and knows what was said before."""

from __future__ import annotations

import importlib.util
import threading
import time

import pytest

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

import rclpy
from nav_msgs.msg import Odometry
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from auv_lse_common.topics.quality import EVERY, LATCHED, LATCHED_READER
from auv_lse_common.topics.ros_conversions import header
from auv_lse_msgs.msg import Dive, MissionCommand, SimStatus
from auv_lse_msgs.srv import RunMission
from auv_lse_record.run_writer import write_run
from auv_lse_run.process.domain import node_environment, note_run, own_domain, run_on
from auv_lse_shore.live.sources import command_calls_node
from auv_lse_shore.live.sources.command_queue import CommandQueue
from auv_lse_shore.live.sources.mission_node import MissionListener
from auv_lse_shore.live.sources.running import MissionFollower, RunningMission, newest_mission
from auv_lse_shore.live.sources.timeline import Timeline

pytestmark = pytest.mark.ros


DIVE = "sim-1123-184534-3f2a"


def wait_for(condition, what):
    until = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < until, what
        time.sleep(0.05)


def test_a_running_mission_is_joined_when_it_runs_and_left_when_it_ends(tmp_path, monkeypatch, synthetic_run):
    run, timeline, stop = tmp_path / "a run", Timeline(), threading.Event()
    write_run(synthetic_run(steps=12), run)  # the part of the mission that was before

    def events(kind):
        return [e for e in timeline.since("", 0, 10**6)[2] if e["kind"] == kind]

    with own_domain() as domain:
        for name, value in node_environment(domain).items():
            monkeypatch.setenv(name, value)
        note_run(domain, run, DIVE)
        assert run_on(domain) == run
        assert newest_mission() == RunningMission(domain, run)
        follower = threading.Thread(target=MissionFollower(timeline, domain, None).follow, args=(stop,), daemon=True)
        context, foreign = Context(), Context()
        for each in (context, foreign):
            rclpy.init(context=each, domain_id=domain)
        node, stranger = Node("mission", context=context), Node("stranger", context=foreign)
        stranger.create_publisher(Dive, "/auv1/dive", LATCHED_READER).publish(Dive(dive="of another dive", node="link"))
        strangers = stranger.create_publisher(Odometry, "/auv1/odometry", EVERY)
        status = node.create_publisher(SimStatus, "/sim/status", LATCHED)
        odometry = node.create_publisher(Odometry, "/auv1/odometry", EVERY)
        status.publish(SimStatus(dive=DIVE, header=header(0.0), state=SimStatus.WAITING, message="for the nodes"))
        follower.start()
        try:
            wait_for(lambda: events("status"), "the simulator is heard")
            assert timeline.state["growing"]
            assert odometry.get_subscription_count() == 0, "nobody is counted among the readers before it runs"
            status.publish(SimStatus(dive=DIVE, header=header(300.0), state=SimStatus.RUNNING, steps=[20, 20]))
            wait_for(odometry.get_subscription_count, "the vehicles are listened to")
            for i in range(10):
                odometry.publish(Odometry(header=header(300.0 + i)))
            wait_for(lambda: [e for e in events("pose") if e["t"] >= 308.0], "odometry is heard")
            wait_for(lambda: events("sent"), "what was said before comes from the recording")
            assert events("mission")[0]["name"] == "a run"
            assert [e["t"] for e in events("pose") if e["vehicle"] == 1 and e["t"] < 200.0]
            name = timeline.since("", 0, 1)[0]
            wait_for(strangers.get_subscription_count, "the stranger has a reader")
            strangers.publish(Odometry(header=header(5.0)))
            assert strangers.wait_for_all_acked(Duration(seconds=30.0))
            for stamp_s in (320.0, 330.0):
                odometry.publish(Odometry(header=header(stamp_s)))
                wait_for(lambda s=stamp_s: [e for e in events("pose") if e["t"] >= s], "odometry is heard")
            assert timeline.since("", 0, 1)[0] == name, "the same mission"
            odometry.publish(Odometry(header=header(5.0)))
            wait_for(lambda: timeline.since("", 0, 1)[0] != name, "time went back: another mission has begun")
        except BaseException:
            stop.set()
            raise
        finally:
            for each in (node, stranger):
                each.destroy_node()
            for each in (context, foreign):
                each.try_shutdown()
    try:
        wait_for(lambda: not timeline.state["growing"], "the mission has ended")
        assert newest_mission() is None or newest_mission().run != run
    finally:
        stop.set()
        follower.join(20)


def test_commands_reach_the_vehicles_and_each_outcome_is_reported(monkeypatch):
    heard, commands = [], CommandQueue()

    def answering(vehicle, accepted):
        def answer(request, response):
            heard.append((vehicle, request.command.command, request.command.team, request.command.source))
            response.accepted, response.message = accepted, f"{vehicle} said it"
            return response

        return answer

    with own_domain() as domain:
        for name, value in node_environment(domain).items():
            monkeypatch.setenv(name, value)
        context = Context()
        rclpy.init(context=context, domain_id=domain)
        node = Node("vehicles", context=context)
        for vehicle, accepted in (("auv1", True), ("auv2", False)):
            node.create_service(RunMission, f"/{vehicle}/mission/run", answering(vehicle, accepted))
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        thread = threading.Thread(target=executor.spin, daemon=True)
        thread.start()
        try:
            monkeypatch.setattr(command_calls_node, "_ANSWER_S", 30.0)
            with MissionListener(3, domain, lambda *_: None, commands=commands) as listener:
                outcomes = commands.order("hold", [1, 2])
                while not outcomes.done():
                    listener.serve(0.05)
                monkeypatch.setattr(command_calls_node, "_ANSWER_S", 0.0)
                silent = commands.order("abort", [3])
                listener.serve(0.05)
                assert silent.result(0) == {3: ("not heard", "no answer within 0 s")}
                monkeypatch.setattr(command_calls_node, "_ANSWER_S", 30.0)
                waiting = commands.order("abort", [3])
                listener.serve(0.05)
            assert waiting.result(0) == {3: ("not heard", "the mission has ended")}
        finally:
            executor.shutdown()
            thread.join(10)
            node.destroy_node()
            context.try_shutdown()
    assert outcomes.result(0) == {1: ("accepted", "auv1 said it"), 2: ("refused", "auv2 said it")}
    assert sorted(h[:3] for h in heard) == [("auv1", MissionCommand.HOLD, False), ("auv2", MissionCommand.HOLD, False)]
    assert all("(live view)" in h[3] for h in heard)
