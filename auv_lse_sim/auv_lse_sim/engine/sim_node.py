"""Simulates INS, DVL and acoustic modem of every vehicle, and drives the mission's time."""

from __future__ import annotations

import auv_lse_common.node.executable  # noqa: F401  # first: prepares the process

# isort: split

import sys
import time
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock as ClockMessage

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.node.base_node import BaseNode
from auv_lse_common.node.dive import tagged
from auv_lse_common.node.entry_point import Main
from auv_lse_common.node.lockstep import Answer, phases_of
from auv_lse_common.support.plurals import counted
from auv_lse_common.topics.plan_codecs import decode_run, decode_waypoint
from auv_lse_common.topics.quality import EVERY, reader_quality, writer_quality
from auv_lse_common.topics.ros_conversions import encoded, message_class, stamp
from auv_lse_common.topics.table import MISSION_TOPICS, VEHICLE_TOPICS, full_name, reader_count
from auv_lse_common.vocabulary.stamps import seconds
from auv_lse_comms.transport import PortWatcher
from auv_lse_msgs.msg import LockstepDone, LockstepTick, MissionCommand, ModemTx
from auv_lse_msgs.srv import RunMission
from auv_lse_sim.engine.conversions import checked_leg, status_report
from auv_lse_sim.engine.parameter_file import parameter_file
from auv_lse_sim.engine.sim_topics_node import VehicleTopics
from auv_lse_sim.engine.simulation import STALLED_S, MissionState, Simulation, Speed
from auv_lse_sim.ground.ground_source import ground_of

#: Minimum time (s of wall clock) between two statuses that differ only in numbers.
_STATUS_PERIOD_S = 0.2


class SimNode(BaseNode):
    """sim_node: the simulated world of all vehicles. Has no namespace; reads the whole mission file (--params-file)."""

    def __init__(self) -> None:
        """Builds the world from the mission file, creates every vehicle's topics, and waits for the nodes."""
        super().__init__("sim_node")
        settings = Settings.load(parameter_file(sys.argv))
        self._settings = settings
        self._sim = Simulation(settings, ground_of(settings), self.lockstep, bool(self.recorded))
        self._waiting_since_s = self._ticked_s = time.monotonic()
        self._factor = settings.sim.real_time_factor or 1.0
        self._speed = Speed()
        self._readers: dict[Publisher, int] = {}
        self._nodes = [name for k in self._sim.vehicles for name in self._sim.nodes(k)]
        self._nodes += ["recorder_node"] * self.recorded
        self._clock_topic = self._publisher("/clock")
        if self.lockstep:  # the vehicles' nodes take the time from the ticks
            self._readers[self._clock_topic] = self.recorded
        self._status = self._publisher("/sim/status")
        self._last_status: tuple[MissionState, str] | None = None
        self._status_s = 0.0
        self._topics = {k: self._connect(k) for k in self._sim.vehicles}
        self.create_subscription(MissionCommand, "/mission/command", self._on_command, EVERY)
        self.create_service(RunMission, "/mission/run", self._on_call)
        self._bytes = self.create_guard_condition(self._on_bytes)
        ports = [port for port in (self._sim.links.rack, self._sim.links.dock) if port is not None]
        self._watchers = [PortWatcher(port, self._bytes.trigger) for port in ports]
        if ports:
            self.create_timer(0.2, self._sim.send_on_deck)
        if self.lockstep:
            self._tick = self._publisher("/lockstep/tick")
            self.create_subscription(LockstepDone, "/lockstep/done", self._on_done, EVERY)
            self.create_timer(1.0, self._watch)
        self.when_matched(self._readers, self._begin)
        self._publish_status(self._sim.state, self._sim.message)

    def _publisher(self, name: str) -> Publisher:
        topic = MISSION_TOPICS[name]
        publisher = self.create_publisher(message_class(topic.kind), name, writer_quality(topic))
        self._readers[publisher] = reader_count(topic, self._nodes, self.together) + self.recorded * topic.recorded
        return publisher

    def _connect(self, k: int) -> VehicleTopics:
        """Creates the publishers for vehicle `k`, and subscribes to its topics."""
        if k not in self._sim.links.modems:
            self._subscribe(k, "modem/tx", self._on_packet)
        self._subscribe(k, "mission/state", self._on_state)
        if k not in self._sim.links.autopilots:
            self._subscribe(k, "waypoint", self._on_waypoint)
        topics = VehicleTopics(self, k, self._sim)
        self._readers |= topics.readers
        return topics

    def _subscribe(self, k: int, name: str, take: Callable[[int, Any], None]) -> None:
        topic = VEHICLE_TOPICS[name]
        # not latched for waypoints: those of an earlier mission are ignored
        quality = EVERY if name == "waypoint" else reader_quality(topic, lockstep=True)

        def receive(message: Any) -> None:
            if not self.ignores(topic, message):
                take(k, message)

        self.create_subscription(message_class(topic.kind), full_name(topic, k), receive, quality)

    # ------------------------------------------------------------------ time

    def _begin(self) -> None:
        self.get_logger().info(f"all nodes are ready; ground: {self._sim.world.ground.describe()}")
        self._sim.begin()
        if not self.lockstep:
            self.create_timer(self._settings.sim.tick_s / self._factor, self._run_tick)
        self._advance()

    def _advance(self) -> None:
        """Lockstep: runs the next tick if it is ready."""
        if self._sim.ready():
            self._run_tick()

    def _run_tick(self) -> None:
        """Runs one tick: advances the world, publishes its output and, in lockstep, announces it."""
        sim = self._sim
        outputs = sim.advance()
        self._ticked_s = time.monotonic()
        for problem in sim.take_problems():
            self.get_logger().error(problem)
        if sim.state is MissionState.FINISHED and self._settings.sim.shutdown_at_end:
            self.create_timer(1.0, rclpy.try_shutdown)
        if outputs:
            self._clock_topic.publish(ClockMessage(clock=stamp(sim.now_s)))
            for k, output in outputs.items():
                sim.deliver(k, output)
            if self.lockstep:  # before the output: a vehicle starts its phase when its last input has arrived
                self._waiting_since_s = time.monotonic()
                self._tick.publish(_tick_message(sim, self.dive))
            for k, output in outputs.items():
                self._topics[k].publish(output)
            for k, output in outputs.items():
                self._topics[k].publish_unread(output)
            self._speed.mark(sim.now_s, time.monotonic())
        self._publish_status(sim.state, sim.message)

    def _watch(self) -> None:
        """Lockstep: reports nodes that do not answer."""
        waited_s = time.monotonic() - self._waiting_since_s
        silence = self._sim.silence(waited_s)
        if not silence or (self._last_status and self._last_status[0] is MissionState.FAILED):
            return  # a mission that has failed stays so until the nodes answer
        self._publish_status(MissionState.FAILED if waited_s > STALLED_S else self._sim.state, silence)

    def _publish_status(self, state: MissionState, message: str) -> None:
        """Publishes the status if its state or message is new, or after `_STATUS_PERIOD_S`."""
        now_s = time.monotonic()
        if (state, message) == self._last_status and now_s - self._status_s < _STATUS_PERIOD_S:
            return
        self._last_status, self._status_s = (state, message), now_s
        report = status_report(self._sim, state, message, self._speed.value)
        topic = MISSION_TOPICS["/sim/status"]
        self._status.publish(tagged(encoded(topic, report, 0), self.dive))

    # ------------------------------------------------------------------ incoming messages

    def _on_waypoint(self, k: int, message: Any) -> None:
        try:
            waypoint = decode_waypoint(message)
            leg, then = checked_leg(waypoint), waypoint.then
        except ValueError as error:
            self.get_logger().error(f"auv{k}: {error}")
            leg, then = None, None
        self._sim.take_waypoint(k, leg, message.speed_mps, then)
        self._advance()

    def _on_state(self, k: int, message: Any) -> None:
        try:
            report = decode_run(message)
        except ValueError as error:
            self.get_logger().error(f"auv{k}: mission/state: {error}")
            return
        self._sim.take_state(k, report.revision, report.status)
        self._advance()

    def _on_command(self, message: MissionCommand) -> None:
        """Passes a command on to all vehicles."""
        if self.ignores(MISSION_TOPICS["/mission/command"], message):
            return
        for k, topics in self._topics.items():
            self._sim.commands[k - 1] += 1
            message.number = self._sim.commands[k - 1]
            topics.command(message)

    def _on_call(self, request: RunMission.Request, response: RunMission.Response) -> RunMission.Response:
        if not request.ask:
            self._on_command(request.command)
        done = "none sent" if request.ask else "sent"
        response.accepted, response.message = True, f"{done} to {counted(len(self._topics), 'vehicle')}"
        response.clock_s = time.monotonic()
        return response

    def _on_packet(self, k: int, message: ModemTx) -> None:
        self._sim.take_packet(k, seconds(message.header.stamp), bytes(message.payload))
        self._advance()

    def _on_bytes(self) -> None:
        passed_s = 0.0 if self.lockstep else (time.monotonic() - self._ticked_s) * self._factor
        self._sim.serve(passed_s)
        for watcher in self._watchers:
            watcher.handled()
        self._advance()

    def _on_done(self, message: LockstepDone) -> None:
        if self.ignores(MISSION_TOPICS["/lockstep/done"], message):
            return
        if message.phase == LockstepDone.RECORDER:
            self._sim.take_recorded(message.tick)
        else:
            answer = Answer(phase=message.phase, totals=tuple(message.totals), finished=message.finished)
            for part in phases_of(answer):
                self._sim.take_done(message.vehicle, part.phase, message.tick, part.totals, part.finished)
        self._advance()

    def destroy_node(self) -> None:
        """Closes the emulated hardware."""
        for watcher in self._watchers:
            watcher.stop()
        self._sim.links.close()
        super().destroy_node()


def _tick_message(sim: Simulation, dive: str) -> LockstepTick:
    """Announces the simulation's last tick."""
    every_tick = [sim.tick] * len(sim.vehicles)
    return LockstepTick(
        stamp=stamp(sim.now_s),
        tick=sim.tick,
        soundings=sim.soundings,
        arrivals=sim.arrivals,
        odometries=every_tick,
        commands=sim.commands,
        dead_reckonings=every_tick,
        fixes=sim.fixes,
        dive=dive,
    )


#: Entry point of `ros2 run auv_lse_sim sim_node`.
main = Main(SimNode)
