"""A whole mission in one process, without ROS: the nodes' cores, called in the order of docs/design/architecture.md.

The nodes make the same calls with the same numbers, so that both give the same mission from the same seed. Where a
message rounds (a stamp to nanoseconds, a heading to a quaternion and back), the fleet rounds too.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.parameter_file import parameters_for
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix, MateNavigation
from auv_lse_common.vocabulary.frames import heading_from_quaternion, quaternion_from_heading
from auv_lse_common.vocabulary.mission_run import Command, RunState, Stop
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_common.vocabulary.stamps import stamped
from auv_lse_comms.bridge import ModemBridge, Received
from auv_lse_comms.intake import BridgeIntake
from auv_lse_comms.ranging import Timing
from auv_lse_comms.settings import bridge_of
from auv_lse_gp.intake import MapIntake
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.map.receivers_risk import ReceiversRisk
from auv_lse_gp.places.position_corrector import PositionCorrector, corrector_for
from auv_lse_planner.methods.decision import Decision
from auv_lse_planner.safety import Safety
from auv_lse_planner.vehicle.intake import PlannerIntake
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner
from auv_lse_record.run_data import (
    DecisionRecord,
    GroundGrid,
    PacketReceived,
    PacketSent,
    RunData,
    VehicleRun,
    origin_of,
)
from auv_lse_sim.ground.ground import Ground
from auv_lse_sim.world import VehicleOutput, World

Array = NDArray[np.float64]


@dataclass(slots=True)
class _Log:
    """What is kept of one vehicle, in lists that grow by the tick."""

    truth: list[tuple[float, float, float, float]] = field(default_factory=list)
    odometry: list[tuple[float, float, float, float]] = field(default_factory=list)
    place_std: list[tuple[float, float]] = field(default_factory=list)
    dead_reckoning: list[tuple[float, float, float, float, float]] = field(default_factory=list)
    fixes: list[Fix] = field(default_factory=list)
    mates: list[MateNavigation] = field(default_factory=list)
    soundings: list[Array] = field(default_factory=list)
    received: list[Soundings] = field(default_factory=list)
    decisions: list[DecisionRecord] = field(default_factory=list)


def _samples(received: Received) -> Array:
    """North, east, depth (m) of a packet's samples, (n, 3), as the packet's float32 hold them."""
    return np.asarray(received.packet.samples, dtype=np.float32).astype(float).reshape(-1, 3)


def _as_message_has_it(raw: DeadReckoning) -> DeadReckoning:
    """A raw place with the rounding of its message: its stamp to nanoseconds, its heading to a quaternion and back."""
    heading_rad = heading_from_quaternion(*quaternion_from_heading(raw.heading_rad))
    return replace(raw, stamp_s=stamped(raw.stamp_s), heading_rad=heading_rad)


def _fix_as_message_has_it(fix: Fix) -> Fix:
    """A fix with its message's rounding of the stamp."""
    return replace(fix, stamp_s=stamped(fix.stamp_s))


def _mate_as_message_has_it(mate: MateNavigation) -> MateNavigation:
    """A mate's navigation with the rounding of its message: its stamp to nanoseconds."""
    return replace(mate, stamp_s=stamped(mate.stamp_s))


class Crew:
    """The cores of one vehicle, wired by direct calls where the nodes exchange messages.

    Attributes:
        vehicle: Its number.
        bridge: Its modem bridge.
        map: Its map.
        safety: Its mission's state and the watch over it.
        planner: Its planner.
        log: What is kept of it.
    """

    def __init__(
        self, vehicle: int, bridge: ModemBridge, to_map: MapIntake, safety: Safety, planner: VehiclePlanner
    ) -> None:
        """Nothing has come in yet."""
        self.vehicle = vehicle
        self.bridge = bridge
        self.map = to_map.map
        self.safety = safety
        self.planner = planner
        self.log = _Log()
        self._to_bridge = BridgeIntake(bridge)
        self._to_map = to_map
        self._to_planner = PlannerIntake(planner)
        self._revision = -1

    @property
    def corrector(self) -> PositionCorrector | None:
        """What corrects the places of its map's soundings, if anything does."""
        return self._to_map.corrector

    def hear(self, output: VehicleOutput) -> list[Received]:
        """The bridge takes own soundings and packets, as modem_node does; returns the packets that it accepts."""
        self._to_bridge.set_dead_reckoning(_as_message_has_it(output.dead_reckoning))
        for fix in output.fixes:
            self._to_bridge.add_fix(_fix_as_message_has_it(fix))
        self._to_bridge.add_soundings(output.soundings)
        for arrival in output.arrivals:
            timing = Timing(sent_s=arrival.sent_s, arrival_s=arrival.heard_s, travel_s=arrival.travel_s)
            self._to_bridge.add_packet(stamped(arrival.arrival_s), arrival.source, arrival.payload, timing)
        heard = self._to_bridge.process()
        for received in heard:
            if self.bridge.must_abort(received):
                self.safety.run.command(Command.ABORT, f"vehicle {received.source}, by acoustic packet", team=True)
        return heard

    def update_map(self, output: VehicleOutput, heard: list[Received]) -> None:
        """The map takes navigation, own soundings and the team's samples, as gp_node does."""
        self._to_map.add_soundings(output.soundings)
        self._to_map.add_dead_reckoning(_as_message_has_it(output.dead_reckoning))
        for fix in output.fixes:
            self._to_map.add_fix(replace(fix, stamp_s=stamped(fix.stamp_s)))
        for received in heard:
            if received.navigation is not None:
                self._to_map.add_navigation(_mate_as_message_has_it(received.navigation))
            if len(received.packet.samples):
                self._to_map.add_samples(received.stamp_s, received.source, _samples(received))
        self._to_map.step(output.odometry.stamp_s)

    def watch(self, now_s: float, output: VehicleOutput) -> Stop | None:
        """The watch looks at odometry and altitude, as safety_node does; returns what stops the vehicle."""
        o, safety = output.odometry, self.safety
        heading = heading_from_quaternion(*quaternion_from_heading(o.heading_rad))
        safety.watch.odometry(heading, o.north_m, o.east_m, output.pressure_depth_m, o.speed_mps)
        safety.watch.altitude(float(np.float32(output.altitude_m)))  # as a Range has it
        if self.planner.finished:
            safety.run.command(Command.END, "planner_node")
        safety.watch.step(now_s, safety.run)
        self._to_planner.set_standing(safety.run.status)
        self.bridge.abort_calls.own = safety.run.status.team_abort
        return safety.run.status.stop

    def decide(self, now_s: float, output: VehicleOutput, heard: list[Received]) -> tuple[Decision, float] | None:
        """The planner takes map, plans and odometry, as planner_node does.

        Returns:
            The decision and the wall clock that it took (s), if one is due.
        """
        for received in heard:
            self._to_planner.add_plan(received.stamp_s, received.source, received.packet.plan)
        o = output.odometry
        heading = heading_from_quaternion(*quaternion_from_heading(o.heading_rad))
        self._to_planner.set_odometry(stamped(o.stamp_s), heading, o.north_m, o.east_m)
        if not self._to_planner.take(now_s):
            return None
        place = None if self.corrector is None else self.corrector.place  # only a decision reads it
        if place is not None:
            self._to_planner.set_corrected(place.stamp_s, place.north_m, place.east_m)
            self._to_planner.apply_correction()
        if self.map.revision != self._revision:  # not before: to be read, merged centers must be settled
            self._revision = self.map.revision
            self.planner.set_centers(self.map.centers, now_s)
        began = time.perf_counter()
        decision = self.planner.decide(now_s)
        return decision, time.perf_counter() - began

    def say(self, now_s: float, decision: Decision | None) -> bytes | None:
        """The bridge takes the plan, as modem_node does; returns the packet to send in the vehicle's slot."""
        if decision is not None:
            self._to_bridge.set_plan(decision.plan)
        return self._to_bridge.poll(now_s)


class Fleet:
    """A team, its world and the mission's clock.

    Args:
        settings: The whole mission.
        ground: What the vehicles sound.
    """

    def __init__(self, settings: Settings, ground: Ground) -> None:
        """Builds the world and the crews; nothing moves yet."""
        self.settings = settings
        self.ground = ground
        self.world = World.of(settings, ground)
        self.area = OperatingArea(settings.area)
        self.crews = [self._crew(number) for number in range(1, settings.mission.vehicles + 1)]
        self.now_s = 0.0
        self.sent: list[PacketSent] = []
        self.received: list[PacketReceived] = []
        self.notes: list[str] = []
        self._wall_s = 0.0
        self._ticks = 0

    def _crew(self, number: int) -> Crew:
        parameters = parameters_for(self.settings.to_patterns(), f"/auv{number}/modem_node")
        own = self.settings.planner_settings(number)
        depth_map = DepthMap(own.gp, self.settings.level_set, self.area)
        return Crew(
            vehicle=number,
            bridge=bridge_of(parameters, f"{self.settings.where} (auv{number})", number, ReceiversRisk.from_parameters),
            to_map=MapIntake(depth_map, corrector_for(number, self.settings.places_in_force(number), depth_map)),
            safety=Safety.of(parameters, f"{self.settings.where} (auv{number})", number),
            planner=VehiclePlanner(number, own, stream(self.settings.mission.seed, "planner", number)),
        )

    @property
    def finished(self) -> bool:
        """Whether every vehicle has travelled all its legs, or has aborted its mission."""
        return all(crew.planner.finished or crew.safety.run.status.state is RunState.ABORTED for crew in self.crews)

    def tick(self) -> None:
        """One tick of the mission."""
        began = time.perf_counter()
        self._ticks += 1
        now_s = stamped(self._ticks * self.settings.sim.tick_s)
        outputs = self.world.tick(now_s)
        self.now_s = now_s
        payloads: list[tuple[int, bytes]] = []
        stops: list[tuple[int, Stop | None]] = []
        decisions: list[tuple[int, Decision]] = []
        for crew in self.crews:
            output = outputs[crew.vehicle]
            heard = crew.hear(output)
            crew.update_map(output, heard)
            stops.append((crew.vehicle, crew.watch(now_s, output)))
            decided = crew.decide(now_s, output, heard)
            payload = crew.say(now_s, decided[0] if decided else None)
            if decided:
                decisions.append((crew.vehicle, decided[0]))
            if payload is not None:
                payloads.append((crew.vehicle, payload))
            self._record(crew, now_s, output, heard, decided)
        for vehicle, stop in stops:
            self.world.obey(vehicle, stop)
        for vehicle, decision in decisions:
            own = self.settings.vehicle(vehicle).vehicle
            last = decision.leg.step == self.settings.mission.steps - 1
            self.world.command(vehicle, decision.leg, own.speed_mps, own.stop_at_end if last else None)
        for vehicle, payload in payloads:
            self.world.transmit(vehicle, now_s, payload)
            self.sent.append(PacketSent(stamp_s=now_s, source=vehicle, payload=payload))
        self._wall_s += time.perf_counter() - began

    def _record(
        self,
        crew: Crew,
        now_s: float,
        output: VehicleOutput,
        heard: list[Received],
        decided: tuple[Decision, float] | None,
    ) -> None:
        log, truth, odometry = crew.log, output.truth, output.odometry
        log.truth.append((now_s, truth.north_m, truth.east_m, truth.heading_rad))
        log.odometry.append((now_s, odometry.north_m, odometry.east_m, odometry.heading_rad))
        log.place_std.append((odometry.covariance[1][1] ** 0.5, odometry.covariance[2][2] ** 0.5))
        raw = _as_message_has_it(output.dead_reckoning)
        log.dead_reckoning.append((raw.stamp_s, raw.north_m, raw.east_m, raw.heading_rad, raw.depth_m))
        log.fixes += [_fix_as_message_has_it(fix) for fix in output.fixes]
        log.mates += [
            _mate_as_message_has_it(received.navigation) for received in heard if received.navigation is not None
        ]
        if len(output.soundings):
            log.soundings.append(output.soundings)
        for received in heard:
            log.received.append(Soundings.of_packet(received.stamp_s, received.source, _samples(received)))
        for arrival in output.arrivals:
            self.received.append(
                PacketReceived(
                    stamp_s=stamped(arrival.arrival_s),
                    receiver=crew.vehicle,
                    source=arrival.source,
                    snr_db=arrival.snr_db,
                    payload=arrival.payload,
                    sent_s=arrival.sent_s,
                    arrival_s=arrival.heard_s,
                    travel_s=arrival.travel_s,
                )
            )
        if decided is not None:
            decision, wall_s = decided
            bound = decision.bound
            log.decisions.append(
                DecisionRecord(
                    now_s=now_s,
                    step=bound.step,
                    plan=decision.plan,
                    jbar=bound.expected_end,
                    reward_so_far=bound.reward_so_far,
                    lower_bound=bound.lower_bound,
                    lower_bound_max=bound.lower_bound_max,
                    wall_s=wall_s,
                    method=bound.method,
                )
            )

    def run(self, progress: Callable[[Fleet], None] | None = None) -> RunData:
        """Runs the mission to its end.

        Args:
            progress: Called after every tick.

        Returns:
            What the mission leaves; if it was stopped after `Settings.longest_s`, its notes say so.
        """
        while not self.finished:
            if self.now_s >= self.settings.longest_s:
                late = [f"auv{crew.vehicle}" for crew in self.crews if not crew.planner.finished]
                self.notes.append(f"stopped at {self.now_s:.0f} s: {', '.join(late)} had not finished")
                break
            self.tick()
            if progress is not None:
                progress(self)
        return self.run_data()

    def run_data(self) -> RunData:
        """The run data up to now."""
        grid = self.crews[0].map.grid
        notes = list(self.notes)
        for number, vehicle in self.world.vehicles.items():
            if vehicle.groundings:
                notes.append(f"auv{number} touched the ground in {vehicle.groundings} ticks")
        return RunData(
            parameters=self.settings.to_patterns(),
            vehicles=[
                VehicleRun(
                    vehicle=crew.vehicle,
                    truth=np.array(crew.log.truth).reshape(-1, 4),
                    odometry=np.array(crew.log.odometry).reshape(-1, 4),
                    soundings=Soundings.from_rows(np.concatenate([np.empty((0, 6)), *crew.log.soundings])),
                    dead_reckoning=np.array(crew.log.dead_reckoning).reshape(-1, 5),
                    fixes=crew.log.fixes,
                    mates=crew.log.mates,
                    received=Soundings.join(crew.log.received),
                    decisions=crew.log.decisions,
                    place_std_m=np.array(crew.log.place_std).reshape(-1, 2),
                )
                for crew in self.crews
            ],
            sent=list(self.sent),
            received=sorted(self.received, key=lambda r: (r.stamp_s, r.receiver, r.source)),
            ground=GroundGrid.sample(self.ground, grid.north_m, grid.east_m, grid.inside),
            sim_s=self.now_s,
            wall_s=self._wall_s,
            origin=self.ground.origin or origin_of(self.settings.to_patterns()),
            notes=notes,
        )
