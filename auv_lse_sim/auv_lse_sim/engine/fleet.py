"""Runs a whole mission in one process without ROS: calls the nodes' cores in the order of docs/design/architecture.md.

The nodes make the same calls with the same numbers, so both produce the same mission from the same seed. Where a
message rounds (a stamp to nanoseconds, a heading to a quaternion and back), the fleet rounds too.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.parameter_file import parameters_for
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.arrays import Array
from auv_lse_common.topics.records import Transmission
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
from auv_lse_gp.map.quality_watch import QualityWatch, slices
from auv_lse_gp.positions.position_corrector import PositionCorrector, corrector_for
from auv_lse_planner.methods.decision import Decision
from auv_lse_planner.safety import Safety
from auv_lse_planner.vehicle.intake import PlannerIntake
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner
from auv_lse_record.run_data import DecisionRecord, GroundGrid, PacketReceived, RunData, VehicleRun, origin_of
from auv_lse_sim.ground.ground import Ground
from auv_lse_sim.world import VehicleOutput, World


@dataclass(slots=True)
class _Log:
    """The record of one vehicle; the lists grow with each tick."""

    truth: list[tuple[float, float, float, float]] = field(default_factory=list)
    odometry: list[tuple[float, float, float, float]] = field(default_factory=list)
    position_std: list[tuple[float, float]] = field(default_factory=list)
    dead_reckoning: list[tuple[float, float, float, float, float]] = field(default_factory=list)
    fixes: list[Fix] = field(default_factory=list)
    mates: list[MateNavigation] = field(default_factory=list)
    soundings: list[Soundings] = field(default_factory=list)
    received: list[Soundings] = field(default_factory=list)
    decisions: list[DecisionRecord] = field(default_factory=list)


def _samples(received: Received) -> Array:
    """North, east, depth (m) of a packet's samples, (n, 3), as the packet's float32 hold them."""
    return np.asarray(received.packet.samples, dtype=np.float32).astype(float).reshape(-1, 3)


def _rounded_dead_reckoning(raw: DeadReckoning) -> DeadReckoning:
    """Dead reckoning as its message rounds it: stamp to nanoseconds, heading to a quaternion and back."""
    heading_rad = heading_from_quaternion(*quaternion_from_heading(raw.heading_rad))
    return replace(raw, stamp_s=stamped(raw.stamp_s), heading_rad=heading_rad)


def _rounded_fix(fix: Fix) -> Fix:
    """A fix as its message rounds it: stamp to nanoseconds."""
    return replace(fix, stamp_s=stamped(fix.stamp_s))


def _rounded_mate(mate: MateNavigation) -> MateNavigation:
    """A mate's navigation as its message rounds it: stamp to nanoseconds."""
    return replace(mate, stamp_s=stamped(mate.stamp_s))


class VehicleCores:
    """The cores of one vehicle, connected by direct calls where the nodes exchange messages.

    Attributes:
        safety: Its mission state and safety limits.
    """

    def __init__(
        self,
        vehicle: int,
        bridge: ModemBridge,
        to_map: MapIntake,
        safety: Safety,
        planner: VehiclePlanner,
        tick_s: float,
    ) -> None:
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
        self._slices = slices(tick_s)

    @property
    def corrector(self) -> PositionCorrector | None:
        """The corrector of its soundings' positions, if it has one."""
        return self._to_map.corrector

    def receive(self, output: VehicleOutput) -> list[Received]:
        """Hands own soundings and received packets to the bridge, as modem_node does; returns the accepted packets."""
        self._to_bridge.set_dead_reckoning(_rounded_dead_reckoning(output.dead_reckoning))
        for fix in output.fixes:
            self._to_bridge.add_fix(_rounded_fix(fix))
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
        """Hands navigation, own soundings and the team's samples to the map, as gp_node does."""
        self._to_map.add_soundings(output.soundings)
        self._to_map.add_dead_reckoning(_rounded_dead_reckoning(output.dead_reckoning))
        for fix in output.fixes:
            self._to_map.add_fix(_rounded_fix(fix))
        for received in heard:
            if received.navigation is not None:
                self._to_map.add_navigation(_rounded_mate(received.navigation))
            if len(received.packet.samples):
                self._to_map.add_samples(received.stamp_s, received.source, _samples(received))
        now_s = output.odometry.stamp_s
        self._to_map.step(now_s)
        is_running = self.safety.run.status.state is RunState.RUNNING
        for _ in range(self._slices):
            quality = self._to_map.judge(now_s, is_running)
            if quality is not None:
                self._to_planner.set_quality(quality)
                break

    def update_safety(self, now_s: float, output: VehicleOutput) -> Stop | None:
        """Checks odometry and altitude, as safety_node does; returns the stop that is in force, if any."""
        o, safety = output.odometry, self.safety
        heading = heading_from_quaternion(*quaternion_from_heading(o.heading_rad))
        safety.watch.odometry(stamped(o.stamp_s), heading, o.north_m, o.east_m, output.pressure_depth_m, o.speed_mps)
        safety.watch.altitude(float(np.float32(output.altitude_m)))  # rounded as in Range
        if self.planner.finished:
            safety.run.command(Command.END, "planner_node")
        safety.step(now_s)
        self._to_planner.set_run_status(safety.run.status)
        self.bridge.set_run_status(safety.run.status)
        then = self.planner.settings.vehicle.stop_at_end if self.planner.finished else None
        return safety.run.status.stop_after(then)

    def decide(self, now_s: float, output: VehicleOutput, heard: list[Received]) -> tuple[Decision, float] | None:
        """Hands map, plans and odometry to the planner, as planner_node does.

        Returns:
            The decision and its wall-clock time (s), or None if none is due.
        """
        for received in heard:
            self._to_planner.add_plan(received.stamp_s, received.source, received.packet.plan)
        o = output.odometry
        heading = heading_from_quaternion(*quaternion_from_heading(o.heading_rad))
        self._to_planner.set_odometry(stamped(o.stamp_s), heading, o.north_m, o.east_m)
        if not self._to_planner.take(now_s):
            return None
        position = None if self.corrector is None else self.corrector.position  # only decisions read it
        if position is not None:
            self._to_planner.set_corrected(position)
            self._to_planner.apply_correction()
        if self.map.revision != self._revision:  # reading settles merged centers, so only now
            self._revision = self.map.revision
            self.planner.set_centers(self.map.centers, now_s)
        began = time.perf_counter()
        decision = self.planner.decide(now_s)
        wall_s = time.perf_counter() - began
        return decision, wall_s

    def next_packet(self, now_s: float, decision: Decision | None) -> bytes | None:
        """Hands the plan to the bridge, as modem_node does; returns the packet to send if the vehicle's slot is due."""
        if decision is not None:
            self._to_bridge.set_plan(decision.plan)
        return self._to_bridge.poll(now_s)


class Fleet:
    """A team, its world and the mission's clock."""

    def __init__(self, settings: Settings, ground: Ground) -> None:
        """Builds the world and the vehicles' cores."""
        self.settings = settings
        self.ground = ground
        self.world = World.of(settings, ground)
        self.area = OperatingArea(settings.area)
        self.cores = [self._build_cores(number) for number in range(1, settings.mission.vehicles + 1)]
        self.now_s = 0.0
        self.sent: list[Transmission] = []
        self.received: list[PacketReceived] = []
        self.notes: list[str] = []
        self._wall_s = 0.0
        self._ticks = 0

    def _build_cores(self, number: int) -> VehicleCores:
        parameters = parameters_for(self.settings.to_patterns(), f"/auv{number}/modem_node")
        own = self.settings.planner_settings(number)
        depth_map = DepthMap(own.gp, self.settings.level_set, self.area)
        return VehicleCores(
            vehicle=number,
            bridge=bridge_of(parameters, f"{self.settings.where} (auv{number})", number),
            to_map=MapIntake(
                depth_map,
                corrector_for(number, self.settings.positions_in_force(number), depth_map),
                QualityWatch.of(own.gp, self.settings.level_set, self.area, own.mission.until),
            ),
            safety=Safety.of(parameters, f"{self.settings.where} (auv{number})", number),
            planner=VehiclePlanner(number, own, stream(self.settings.mission.seed, "planner", number)),
            tick_s=self.settings.sim.tick_s,
        )

    @property
    def finished(self) -> bool:
        """Whether every vehicle's mission is over: its legs are travelled and its end reported, or it is aborted."""
        states = [cores.safety.run.status.state for cores in self.cores]
        return all(
            state is RunState.ABORTED or (cores.planner.finished and state is not RunState.RUNNING)
            for cores, state in zip(self.cores, states, strict=True)
        )

    def tick(self) -> None:
        """Runs one tick of the mission."""
        began = time.perf_counter()
        self._ticks += 1
        now_s = stamped(self._ticks * self.settings.sim.tick_s)
        outputs = self.world.tick(now_s)
        self.now_s = now_s
        payloads: list[tuple[int, bytes]] = []
        stops: list[tuple[int, Stop | None]] = []
        decisions: list[tuple[VehicleCores, Decision]] = []
        for cores in self.cores:
            output = outputs[cores.vehicle]
            heard = cores.receive(output)
            stops.append((cores.vehicle, cores.update_safety(now_s, output)))
            cores.update_map(output, heard)
            decided = cores.decide(now_s, output, heard)
            payload = cores.next_packet(now_s, decided[0] if decided else None)
            if decided:
                decisions.append((cores, decided[0]))
            if payload is not None:
                payloads.append((cores.vehicle, payload))
            self._record(cores, now_s, output, heard, decided)
        for vehicle, stop in stops:
            self.world.obey(vehicle, stop)
        for cores, decision in decisions:
            own = cores.planner.settings.vehicle
            then = own.stop_at_end if cores.planner.is_last(decision.leg) else None
            self.world.command(cores.vehicle, decision.leg, own.speed_mps, then)
        for vehicle, payload in payloads:
            self.world.transmit(vehicle, now_s, payload)
            self.sent.append(Transmission(stamp_s=now_s, source=vehicle, payload=payload))
        self._wall_s += time.perf_counter() - began

    def _record(
        self,
        cores: VehicleCores,
        now_s: float,
        output: VehicleOutput,
        heard: list[Received],
        decided: tuple[Decision, float] | None,
    ) -> None:
        log, truth, odometry = cores.log, output.truth, output.odometry
        log.truth.append((now_s, truth.north_m, truth.east_m, truth.heading_rad))
        log.odometry.append((now_s, odometry.north_m, odometry.east_m, odometry.heading_rad))
        log.position_std.append((odometry.covariance[1][1] ** 0.5, odometry.covariance[2][2] ** 0.5))
        raw = _rounded_dead_reckoning(output.dead_reckoning)
        log.dead_reckoning.append((raw.stamp_s, raw.north_m, raw.east_m, raw.heading_rad, raw.depth_m))
        log.fixes += [_rounded_fix(fix) for fix in output.fixes]
        log.mates += [_rounded_mate(received.navigation) for received in heard if received.navigation is not None]
        if len(output.soundings):
            log.soundings.append(output.soundings)
        for received in heard:
            log.received.append(Soundings.of_packet(received.stamp_s, received.source, _samples(received)))
        for arrival in output.arrivals:
            self.received.append(
                PacketReceived(
                    stamp_s=stamped(arrival.arrival_s),
                    receiver=cores.vehicle,
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
                    void=bool(bound.void),
                )
            )

    def run(self, progress: Callable[[Fleet], None] | None = None) -> RunData:
        """Runs the mission to its end.

        Args:
            progress: Called after every tick.

        Returns:
            The run data; a note reports a stop after `Settings.longest_s`.
        """
        while not self.finished:
            if self.now_s >= self.settings.longest_s:
                late = [f"auv{cores.vehicle}" for cores in self.cores if not cores.planner.finished]
                self.notes.append(f"stopped at {self.now_s:.0f} s: {', '.join(late)} had not finished")
                break
            self.tick()
            if progress is not None:
                progress(self)
        return self.run_data()

    def run_data(self) -> RunData:
        """The run data up to now."""
        grid = self.cores[0].map.grid
        notes = list(self.notes)
        for number, vehicle in self.world.vehicles.items():
            if vehicle.groundings:
                notes.append(f"auv{number} touched the ground in {vehicle.groundings} ticks")
        return RunData(
            parameters=self.settings.to_patterns(),
            vehicles=[
                VehicleRun(
                    vehicle=cores.vehicle,
                    truth=np.array(cores.log.truth).reshape(-1, 4),
                    odometry=np.array(cores.log.odometry).reshape(-1, 4),
                    soundings=Soundings.join(cores.log.soundings),
                    dead_reckoning=np.array(cores.log.dead_reckoning).reshape(-1, 5),
                    fixes=cores.log.fixes,
                    mates=cores.log.mates,
                    received=Soundings.join(cores.log.received),
                    decisions=cores.log.decisions,
                    position_std_m=np.array(cores.log.position_std).reshape(-1, 2),
                    unfinished_legs=int(not cores.planner.finished),
                )
                for cores in self.cores
            ],
            sent=list(self.sent),
            received=sorted(self.received, key=lambda r: (r.stamp_s, r.receiver, r.source)),
            ground=GroundGrid.sample(self.ground, grid.north_m, grid.east_m, grid.inside),
            end_s=self.now_s,
            wall_s=self._wall_s,
            origin=self.ground.origin or origin_of(self.settings.to_patterns()),
            notes=notes,
        )
