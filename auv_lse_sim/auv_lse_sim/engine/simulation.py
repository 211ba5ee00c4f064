"""The simulated side of a mission, without ROS and without a clock: the core of `sim_node`.

It owns the world, the emulated hardware, the mission's state and, in lockstep, the conditions for the next tick: the
waypoints and packets that the nodes announce for this tick, and the answers of the hardware drivers.
"""

import enum
import math
from collections.abc import Sequence

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.node.lockstep import Gate
from auv_lse_common.topics.table import announces
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.mission_run import RunState, RunStatus, Stop
from auv_lse_common.vocabulary.stamps import stamped
from auv_lse_common.vocabulary.vehicle_nodes import vehicle_nodes
from auv_lse_sim.emulated.links import EmulatedLinks
from auv_lse_sim.emulated.pings import MiniPacket
from auv_lse_sim.engine.processes import RECORDER_LAG_TICKS
from auv_lse_sim.ground.ground import Ground
from auv_lse_sim.world import VehicleOutput, World

#: In lockstep, a missing answer is named after this wall-clock time (s), and ends the mission after the second one.
QUIET_S, STALLED_S = 15.0, 60.0
#: Up to this simulated time (s) in which all vehicles wait or hold does not count towards the mission's time limit.
MAX_HELD_S = 6.0 * 3600.0
#: In lockstep, which may run unattended, a mission fails when every vehicle has waited or held for this simulated time
#: (s) without a command.
LONGEST_HELD_S = 1800.0
#: Time (s) after its last leg in which a separate vehicle can report the end; the simulator does not hear the report.
APART_S = 10.0
_HELD = (RunState.WAITING, RunState.HOLDING)


class MissionState(enum.Enum):
    """State of a mission."""

    WAITING = "waiting"
    RUNNING = "running"
    FINISHED = "finished"
    FAILED = "failed"


class Simulation:
    """The world of a mission, its emulated hardware, and its ticks.

    Attributes:
        links: The emulated modems and autopilots.
        vehicles: Numbers of the vehicles.
        message: Why it waits or has failed; else the vehicles that wait or hold, and why.
        tick: Number of the last tick; 0 before the first.
        steps: Legs travelled, per vehicle.
        steps_total: Legs of the mission.
        soundings: Soundings made so far, per vehicle.
        arrivals: Packets received so far, per vehicle.
        commands: Commands given to the missions so far, per vehicle.
        runs: Each vehicle's last reported mission state.
        fixes: Fixes so far, per vehicle; 0 with an emulated autopilot, whose driver detects them.
        sent: Packets sent by the team.
        received: Packets received by the team.
        lost: Receptions that the channel lost.
        origin_deg: Latitude and longitude of north = east = 0; None if unknown.
        problems: Errors since the last `take_problems`.
    """

    def __init__(self, settings: Settings, ground: Ground, lockstep: bool, recorded: bool) -> None:
        """Builds the world and opens the ports of the emulated hardware.

        Args:
            lockstep: Whether a tick waits for the nodes.
            recorded: Whether a recorder runs.

        Raises:
            ParameterError: if a port cannot be opened; names it and the reason.
        """
        self.world = World.of(settings, ground)
        self.vehicles = range(1, settings.mission.vehicles + 1)
        world = self.world
        self.links = EmulatedLinks(settings, self._on_emulated_packet, world)
        self.state = MissionState.WAITING
        self.message = "for the mission's nodes"
        self.tick = 0
        self.now_s = 0.0
        self.steps, self.soundings, self.arrivals, self.commands, self.fixes = (
            [0] * len(self.vehicles) for _ in range(5)
        )
        self.runs = [RunState.RUNNING] * len(self.vehicles)
        self._statuses: dict[int, RunStatus] = {}  # each vehicle's last reported status
        self.steps_total = settings.mission.steps
        self.sent = self.received = self.lost = 0
        self.problems: list[str] = []
        self._settings = settings
        self.origin_deg = settings.area.origin_deg
        self._lockstep, self._recorded = lockstep, recorded
        self._finished = [False] * len(self.vehicles)
        self._ended_s = [math.inf] * len(self.vehicles)
        self._transmissions: list[tuple[float, int, bytes]] = []
        self._legs: dict[int, Leg] = {}  # the last leg of each vehicle
        self._thens: dict[int, Stop | None] = {}  # the stop after it
        self._begun_legs = [0] * len(self.vehicles)
        self._begun = False
        self._held_s = 0.0  # time in which every vehicle waited or held
        self._stuck_s = 0.0  # the latest such time without a break, while no command is awaited
        self._present: set[tuple[int, str]] = set()
        self._recorded_tick = 0
        self._targets_accepted = [0] * len(self.vehicles)
        self._lost_by_modem = [0] * len(self.vehicles)
        inputs = [f"packets of auv{k}" for k in self.vehicles]
        inputs += [f"waypoints of auv{k}" for k in self.vehicles]
        inputs += [f"states of auv{k}" for k in self.vehicles]
        inputs += [f"targets of auv{k}" for k in self.links.autopilots]
        inputs += [f"modem of auv{k}" for k in self.links.modems]
        self._gate = Gate(inputs)

    def nodes(self, k: int) -> tuple[str, ...]:
        """Names of the nodes of vehicle `k` that share the simulator's ROS domain."""
        if self._settings.sim.apart:
            return ()
        return tuple(name for _, name in vehicle_nodes(k in self.links.modems, k in self.links.autopilots))

    # ------------------------------------------------------------------ time

    @property
    def finished(self) -> bool:
        """Whether every vehicle's mission is over: its last leg is travelled and its end reported, or it is aborted.

        In lockstep one that ends early, as with a battery that suffices for the way home alone, is over at once.
        """
        return all(
            run is RunState.ABORTED
            or (run is RunState.ENDED and self._lockstep)
            or (done and (run is not RunState.RUNNING or self._settings.sim.apart))
            for done, run in zip(self._finished, self.runs, strict=True)
        )

    def begin(self) -> None:
        """Allows the first tick, because every topic has its readers."""
        self._begun = True

    def ready(self) -> bool:
        """Lockstep: whether the next tick may run.

        The first tick waits for `begin` and for a report of every node of every vehicle. Later ticks wait until every
        vehicle has handled the last tick and the recorder is not far behind. A mission ends only after the recorder has
        reached the last tick, because stopping it earlier would lose messages.
        """
        if not self._lockstep:
            return False
        if self.tick == 0:
            return self._begun and len(self._present) == sum(len(self.nodes(k)) for k in self.vehicles)
        return not self._recorder_behind() and self._gate.ready() is not None

    def _recorder_behind(self) -> bool:
        allowed = 0 if self.finished else RECORDER_LAG_TICKS
        return self._recorded and self._recorded_tick < self.tick - allowed

    def advance(self) -> dict[int, VehicleOutput]:
        """Runs one tick: sends waiting packets, moves the world, and updates the emulated hardware.

        Returns:
            The tick's output per vehicle; empty if the mission has ended (see `state`).
        """
        if self._lockstep and self.tick:
            self.serve()  # on a busy computer, what the drivers have sent may not have been read yet
            self._gate.handled(self.tick)
        self._transmit()
        if self.finished:
            aborted = [f"auv{k}" for k in self.vehicles if self.runs[k - 1] is RunState.ABORTED]
            early = [f"auv{k}: {s.reason}" for k, s in sorted(self._statuses.items()) if s.ended_early]
            self.state, self.message = MissionState.FINISHED, "every vehicle has travelled its last leg"
            if aborted:
                self.message = f"aborted: {', '.join(aborted)}; the others have travelled their last leg"
            elif early:
                self.message = f"ended early: {'; '.join(early)}"
            elif max(self._steps_of(k) for k in self.vehicles) < self.steps_total:
                self.message = f"the quality asked for was reached: {self._settings.mission.until.text}"
            return {}
        self.tick += 1
        self.now_s = self.tick * self._settings.sim.tick_s
        holding = self._holding()
        over = sum(run in (RunState.ENDED, RunState.ABORTED) for run in self.runs)
        if self._is_stuck(bool(holding) and len(holding) + over == len(self.runs)):
            why = f"every vehicle under way has been held for {self._stuck_s:.0f} s, and nothing simulated ends that"
            self.state, self.message = MissionState.FAILED, f"{why}: {'; '.join(holding)}"
            return {}
        if self.now_s - self._held_s > self._settings.longest_s:
            slow = [k for k in self.vehicles if not self._finished[k - 1]]
            self.state, self.message = (
                MissionState.FAILED,
                f"time limit: vehicles {slow} have not finished by {self.now_s:.0f} s",
            )
            return {}
        self.state, self.message = MissionState.RUNNING, "; ".join(holding)
        self.links.poll(self.now_s)
        outputs = self.world.tick(self.now_s)
        self.lost += len(self.world.lost)
        for k, output in outputs.items():
            self._count(k, output)
        for k in self.links.modems:
            self._gate.announce(self.tick, f"modem of auv{k}", self.tick)
        return outputs

    def _holding(self) -> list[str]:
        """The vehicles that wait or hold, each with the reason."""
        found = []
        for k, run in enumerate(self.runs, 1):
            if run in _HELD:
                reason = self._statuses[k].reason if k in self._statuses else ""
                found.append(f"auv{k} {run.name}" + (f" ({reason})" if reason else ""))
        return found

    def _is_stuck(self, all_held: bool) -> bool:
        """Counts a tick in which all vehicles were held, or not; returns whether the mission cannot go on by itself."""
        if all_held:
            self._held_s = min(self._held_s + self._settings.sim.tick_s, MAX_HELD_S)
        awaited = not self._statuses or any(status.waits_for_people for status in self._statuses.values())
        self._stuck_s = self._stuck_s + self._settings.sim.tick_s if all_held and not awaited else 0.0
        return self._lockstep and self._stuck_s > LONGEST_HELD_S

    def _steps_of(self, k: int) -> int:
        """Steps of vehicle `k`: fewer than planned if its last leg came early (`mission.until`).

        The simulator receives no waypoints of a vehicle with an autopilot; the legs that it has begun count instead.
        """
        if k in self.links.autopilots and self._settings.mission.until.is_asked:
            return min(self._begun_legs[k - 1], self.steps_total)
        is_last = self._thens.get(k) is not None
        return self._legs[k].step + 1 if is_last else self.steps_total

    def deliver(self, k: int, output: VehicleOutput) -> None:
        """Passes the tick's output to the emulated modem and autopilot of vehicle `k`, where it has them."""
        if k in self.links.modems:
            unreadable = [a for a in self.world.lost if a.receiver == k and a.audible]
            for arrival in sorted((*output.arrivals, *unreadable), key=lambda a: a.arrival_s):
                self.links.arrive(self.now_s, k, arrival)
            self.arrivals[k - 1] = self.links.delivered(k)  # the driver gets only the answers to its pings
        if k in self.links.autopilots:
            self.links.report(k, self.now_s, output)

    def silence(self, waited_s: float) -> str:
        """Lockstep: the answers still missing after `waited_s` (s of wall clock); "" before `QUIET_S`."""
        if self.tick == 0 or self.state is MissionState.FINISHED or waited_s <= QUIET_S:
            return ""
        missing = [f"{name}: {count}" for name, count in self._gate.missing().items()]
        if self._recorder_behind():
            missing.append(f"recorder: tick {self._recorded_tick} of {self.tick}")
        return f"tick {self.tick}: no answer for {waited_s:.0f} s; missing {', '.join(missing)}"

    def _count(self, k: int, output: VehicleOutput) -> None:
        i = k - 1
        if not self._finished[i] and self.runs[i] is not RunState.ENDED:
            self._begun_legs[i] = output.truth.step + 1
        steps = self._steps_of(k)
        self.soundings[i] += len(output.soundings)
        packets = [arrival for arrival in output.arrivals if MiniPacket.read(arrival.payload) is None]
        if k not in self.links.modems:
            self.arrivals[i] += len(output.arrivals)
        self.fixes[i] += len(output.fixes) if k not in self.links.autopilots else 0
        self.received += len(packets)
        if not self._lockstep:
            last = self.steps_total if k in self.links.autopilots else steps
            ended = self.runs[i] is RunState.ENDED or output.truth.step >= last - 1
            is_over = ended and (output.truth.loitering or self._is_stopped_at_end(k))
            self._ended_s[i] = min(self._ended_s[i], self.now_s) if is_over else math.inf
            self._finished[i] = self.now_s >= self._ended_s[i] + (APART_S if self._settings.sim.apart else 0.0)
        travelled = self.runs[i] is RunState.ENDED and output.truth.step >= steps - 1
        self.steps[i] = steps if travelled or self._finished[i] else max(output.truth.step, 0)

    def _is_stopped_at_end(self, k: int) -> bool:
        """Whether vehicle `k` has ended and obeys a command instead of what follows its last leg."""
        if self.runs[k - 1] is not RunState.ENDED or k in self.links.autopilots:
            return False
        return self._statuses[k].stop_after(self._thens.get(k)) is not None

    # ------------------------------------------------------------------ what the vehicles do

    def take_waypoint(self, k: int, leg: Leg | None, speed_mps: float = math.nan, then: Stop | None = None) -> None:
        """Gives vehicle `k` its next leg; ignores repetitions. None: the waypoint was invalid.

        Args:
            speed_mps: Speed through the water; NaN: the vehicle's own.
            then: What follows the mission's last leg.
        """
        if leg is not None and leg != self._legs.get(k):
            self._legs[k], self._thens[k] = leg, then
            try:
                self.world.command(k, leg, None if math.isnan(speed_mps) else speed_mps, then)
            except ValueError as error:
                self.problems.append(f"auv{k}: {error}")
        self._gate.count(f"waypoints of auv{k}")

    def take_state(self, k: int, revision: int, status: RunStatus) -> None:
        """Handles the mission status of vehicle `k`; without an autopilot the vehicle stops or continues at once."""
        self.runs[k - 1], self._statuses[k] = status.state, status
        if k not in self.links.autopilots:
            self.world.obey(k, status.stop_after(self._thens.get(k)))
        self._gate.reach(f"states of auv{k}", revision)

    def take_packet(self, k: int, stamp_s: float, payload: bytes) -> None:
        """Queues a packet of vehicle `k` that starts at `stamp_s` (s); it is sent before the next tick."""
        self._gate.count(f"packets of auv{k}")
        self._transmissions.append((stamp_s, k, payload))

    def _transmit(self) -> None:
        transmissions, self._transmissions = sorted(self._transmissions, key=lambda t: t[:2]), []
        for stamp_s, k, payload in transmissions:
            try:
                self.world.transmit(k, max(stamp_s, self.now_s), payload)
                self.sent += 1
            except ValueError as error:
                self.problems.append(f"packet of auv{k} at {stamp_s:.1f} s: {error}")

    def take_problems(self) -> list[str]:
        """Returns the errors since the last call, for the log."""
        problems, self.problems = self.problems, []
        return problems

    # ------------------------------------------------------------------ emulated modems and autopilots

    def send_on_deck(self) -> None:
        """Lets the drivers find their autopilots and the zero of depth before the first tick."""
        if self.tick == 0:
            self.links.send_on_deck(self.now_s)

    def serve(self, passed_s: float = 0.0) -> None:
        """Reads and answers the drivers' bytes; never blocks.

        Args:
            passed_s: Simulated time since the last tick, if it passes between ticks.
        """
        passed_s = min(passed_s, self._settings.sim.tick_s) if self.tick else 0.0
        self.links.serve(self.now_s + passed_s)
        for k in self.links.autopilots:
            targets, missions = self.links.accepted(k)
            accepted = missions if self._settings.vehicle(k).link.mode == "mission" else targets
            self._gate.count(f"targets of auv{k}", accepted - self._targets_accepted[k - 1])
            self._targets_accepted[k - 1] = accepted

    def _on_emulated_packet(self, k: int, start_s: float, payload: bytes) -> float:
        mini = MiniPacket.read(payload)
        if mini is not None and mini.answer:  # the modem answers by itself: no node has announced it
            self._transmissions.append((stamped(start_s), k, payload))
        else:
            self.take_packet(k, stamped(start_s), payload)
        return self.world.channel.duration_s(len(payload))

    # ------------------------------------------------------------------ lockstep

    def take_done(self, k: int, phase: str, tick: int, totals: Sequence[int], finished: bool) -> None:
        """Records that a node of vehicle `k` has handled its phase of a tick; arguments as in LockstepDone."""
        if tick == 0:
            self._present.add((k, phase))
            return
        counts = dict(zip(announces(phase), totals, strict=True))
        match phase:
            case "planner":
                self._finished[k - 1] = finished
                if finished:
                    self.steps[k - 1] = self._steps_of(k)
                self._gate.announce(tick, f"waypoints of auv{k}", counts["waypoint"])
            case "safety":
                self._gate.announce(tick, f"states of auv{k}", counts["mission/state"])
            case "modem_sent":
                self._gate.announce(tick, f"packets of auv{k}", counts["modem/tx"])
            case "vehicle_link":  # targets sent to the autopilot, once it has this many waypoints
                self._gate.announce(tick, f"targets of auv{k}", counts["targets"])
                self._gate.reach(f"waypoints of auv{k}", counts["waypoint"])
            case "micromodem":
                self._gate.count(f"modem of auv{k}")
            case "micromodem_lost":  # the driver could not send this packet, so do not wait for it
                self._gate.count(f"packets of auv{k}", counts["modem/failed"] - self._lost_by_modem[k - 1])
                self._lost_by_modem[k - 1] = counts["modem/failed"]

    def take_recorded(self, tick: int) -> None:
        """Records that the recorder has read `tick` and everything published before it."""
        self._recorded_tick = max(self._recorded_tick, tick)


class Speed:
    """Measures simulated seconds per second of wall clock over the last few seconds.

    Attributes:
        value: The speed; 0 before the second mark.
    """

    def __init__(self) -> None:
        self.value = 0.0
        self._marks: list[tuple[float, float]] = []

    def mark(self, sim_s: float, wall_s: float) -> None:
        """Adds a mark: mission time `sim_s` (s) at wall clock `wall_s` (s)."""
        if self._marks and wall_s - self._marks[-1][0] < 0.2:
            return
        self._marks = [*self._marks[-25:], (wall_s, sim_s)]
        (wall_0, sim_0), (wall_1, sim_1) = self._marks[0], self._marks[-1]
        if wall_1 > wall_0:
            self.value = (sim_1 - sim_0) / (wall_1 - wall_0)
