"""A simulated ArduSub or ArduRover over MAVLink, as the real firmware behaves in its own simulator (facts.toml).

It boots disarmed in MANUAL. A ground station arms it and chooses the mode: GUIDED follows position targets, AUTO an
uploaded mission. Entering GUIDED, and arming, clear target and speed. Targets that arrive while it is disarmed, or in
another mode, have no effect. After a lost ground station or a leak ArduSub surfaces and stays there in ALT_HOLD.

`guidance.py` moves the vehicle, `failsafe.py` judges silence, `auto_mission.py` keeps the mission, `streams.py` sends.
"""

import dataclasses
import math
from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from auv_lse_mavlink.messages.conversion import Target, target_of_item, target_of_position
from auv_lse_mavlink.messages.datum import Origin
from auv_lse_mavlink.messages.wire import MavlinkCodec, Message, mavlink
from auv_lse_sim.emulated.ardupilot.auto_mission import ACTIVE, COMPLETE, AutoMission, can_fly
from auv_lse_sim.emulated.ardupilot.commands import COMMANDS, MESSAGES
from auv_lse_sim.emulated.ardupilot.estimator import Estimator
from auv_lse_sim.emulated.ardupilot.failsafe import INFO, WARNING, Failsafes, Response
from auv_lse_sim.emulated.ardupilot.feeder import Feeder
from auv_lse_sim.emulated.ardupilot.guidance import Pose, RoverGuidance, SubGuidance
from auv_lse_sim.emulated.ardupilot.parameter_protocol import ParameterProtocol
from auv_lse_sim.emulated.ardupilot.parameters import ROVER_DEFAULTS, SUB_DEFAULTS, Parameters
from auv_lse_sim.emulated.ardupilot.pilot import OrderedPilot
from auv_lse_sim.emulated.ardupilot.setup import Setup
from auv_lse_sim.emulated.ardupilot.streams import Status, Streams, mission_current
from auv_lse_sim.emulated.autopilot_report import AIR_PA, Report
from auv_lse_sim.emulated.fault import Fault
from auv_lse_sim.emulated.mission_protocol import MissionProtocol

#: Time (s) after a failsafe until the operator acts.
OPERATOR_S = 10.0
#: Periods (s) of TIMESYNC requests, of the text and the parameters that it sends unasked.
TIMESYNC_S, ELEVATION_S, RUNTIME_S, GROUND_PRESSURE_S = 10.0, 1.0, 30.0, 11.0
#: A vehicle this deep (m) is at the surface; a target within this distance (m) of the vehicle is a stop.
SURFACE_M, STOP_M = 0.3, 3.0
#: A mission item is reached within this distance (m), whatever its own radius, and this time (s) after its start.
REACHED_M, REACHED_S = 2.0, 1.5
#: SURFACE lasts at least this (s); a boot is critical for this (s).
SURFACE_S, BOOT_S = 1.0, 1.5
#: Number of pressures that are sent on deck, at once.
ON_DECK = 8


class ArduPilot:
    """One vehicle's autopilot.

    Attributes:
        counts: "targets" (position targets received, ignored ones too), "followed", "missions" (accepted), "refused".
        fault: How it misbehaves; may be set at any time.
        estimator: Its origin and position.
        mode: Number of its mode.
        pilot: Moves the vehicle.
        battery: Charge, 0 to 1.
        has_echo: Whether the range finder's source sends.
    """

    def __init__(
        self,
        system_id: int,
        start: tuple[float, float, float],
        origin: Origin | None,
        take_over: Callable[[OrderedPilot], None],
        setup: Setup,
    ) -> None:
        """Starts as installed, switched on some minutes ago.

        Args:
            system_id: MAVLink system id (the vehicle's number).
            start: Heading (rad), north, east (m).
            origin: The mission's origin; None: no geodetic positions.
            take_over: Called with the pilot when the vehicle is first armed.
            setup: How it is installed.
        """
        self.counts: Counter[str] = Counter()
        self.fault = Fault.NONE
        self.battery, self.has_echo = 0.99, True
        self.setup, self.own = setup, setup.personality
        is_sub = self.own.surface is not None
        self.parameters = Parameters(SUB_DEFAULTS if is_sub else ROVER_DEFAULTS, setup.renamed)
        self.parameters.put(SYSID_THISMAV=float(system_id), **setup.parameters)
        self.parameters.boot()
        self.failsafes = Failsafes(self.own, self.parameters, setup.patience)
        self.estimator = Estimator(setup, origin)
        self.streams = Streams(self.own, self.parameters, self.estimator)
        self._parameter_protocol = ParameterProtocol(self.parameters, self.send)
        self.guidance = SubGuidance(Pose.at_rest(*start)) if is_sub else RoverGuidance(Pose.at_rest(*start))
        self.pilot = OrderedPilot(self.guidance)
        self._take_over: Callable[[OrderedPilot], None] | None = take_over
        self._id, self._operator_mode = (system_id, setup.component_id), setup.operator_mode
        self._failed_s = -math.inf  # last time of a failsafe that acts
        self._codec = MavlinkCodec(*self._id)
        self._feeder = Feeder()
        self._out: list[bytes] = []
        self._now_s = 0.0
        self._last = Report(heading_rad=start[0], north_m=start[1], east_m=start[2], depth_m=0.0)
        self._start_up()

    def _start_up(self) -> None:
        """Resets the state that a boot clears."""
        self.armed, self.mode = False, self.own.manual
        self.mission = AutoMission()
        self._upload = MissionProtocol(self.send, self._accept, asks_int=False)
        self._target: Target | None = None
        self._since_s = self._now_s  # when the mode or the target was set
        self._speed_mps = math.nan
        self._last_s: dict[str, float] = {}
        self.streams.boot()

    # ------------------------------------------------------------------ calls of the owner

    def receive(self, now_s: float, data: bytes) -> None:
        """Handles bytes from a companion or ground station."""
        self._tick(now_s)
        for message in self._codec.decode(data):
            target = getattr(message, "target_system", 0)
            sender = message.get_srcSystem(), message.get_srcComponent()
            if sender == self._id or target not in (0, self._id[0]):
                continue
            if self._upload.handle(now_s, message, self.fault is Fault.REFUSES) or self._parameter_protocol.handle(
                message
            ):
                continue
            handler = HANDLERS.get(message.get_type())
            if handler is not None:
                handler(self, message)

    def report(self, now_s: float, report: Report) -> None:
        """Updates the vehicle's estimate at the end of a tick, and sends the telemetry."""
        self._tick(now_s)
        moved_m = math.dist((report.north_m, report.east_m), (self._last.north_m, self._last.east_m))
        self.battery = max(self.battery - moved_m / self.setup.lasts_m, 0.0)
        self._last = report
        self.guidance.correct(now_s, report.north_m, report.east_m, report.depth_m, report.heading_rad)
        self._operate()
        self._step_failsafes()
        self._step_mission()
        if self.estimator.settle(report.gps_m is not None):
            self._announce_origin()
        if self._is_due("heartbeat", 1.0):
            self._send_heartbeat()
        self._send_unasked()
        moving = dataclasses.replace(report, climb_mps=-float(self.pilot.at(now_s).velocity_mps[2]))
        for message in self.streams.due(now_s, moving, self._status()):
            self.send(message)
        self._upload.poll(now_s)
        if self.setup.feeds:
            self._out += self._feeder.messages(now_s, report, self.has_echo)

    def send_on_deck(self, now_s: float, pressure_pa: float = AIR_PA) -> None:
        """Sends what the other side needs before the mission.

        Args:
            pressure_pa: Pressure on deck.
        """
        self._tick(now_s)
        last = self._last
        here = Report(
            heading_rad=last.heading_rad, north_m=last.north_m, east_m=last.east_m, depth_m=0.0, pressure_pa=pressure_pa
        )
        self._send_heartbeat()
        for _ in range(ON_DECK):
            self.streams.forget_times()
            for message in self.streams.due(now_s, here, self._status()):
                self.send(message)

    def move_origin(self, up_m: float) -> None:
        """Moves the estimator's origin up (m), as a correction by GPS or a ground station does."""
        self.estimator.height_m += up_m

    def reboot(self, now_s: float) -> None:
        """Boots: parameters take effect; origin, mission and mode are lost."""
        self._tick(now_s)
        self.estimator.boot()
        self.parameters.boot()
        self.failsafes.boot(now_s)
        self.pilot.order(now_s, self.guidance.drift)
        self._start_up()
        self.say(INFO, "ArduPilot Ready")
        self._send_heartbeat()

    def outgoing(self) -> list[bytes]:
        """The datagrams to send; returns each once."""
        data, self._out = self._out, []
        return data

    # ------------------------------------------------------------------ what commands and handlers use

    @property
    def now_s(self) -> float:
        """Time of the present call (s)."""
        return self._now_s

    def send(self, message: Message) -> None:
        """Queues a message."""
        self._out.append(self._codec.encode(message))

    def say(self, severity: int, text: str) -> None:
        """Sends a status text."""
        self.send(mavlink.MAVLink_statustext_message(severity, text.encode("ascii", "replace")[:50]))

    def arm(self, on: bool) -> bool:
        """Arms or disarms; returns whether it did."""
        if on == self.armed:
            return True
        self.armed = on
        self._target, self._speed_mps = None, math.nan
        if on:
            if self._take_over is not None:
                self._take_over(self.pilot)
                self._take_over = None
            if self.own.surface is not None:
                self.send_origin(home=True)
            self._enter_mode()
        else:
            self.failsafes.disarmed()
            self.pilot.order(self._now_s, self.guidance.drift)
        self.say(INFO, self.own.armed_text if on else self.own.disarmed_text)
        return True

    def set_mode(self, number: int) -> bool:
        """Changes the mode; returns whether it could."""
        if number not in self.own.base_modes:
            return False
        if number in (self.own.guided, self.own.auto) and not self.estimator.has_position:
            self.say(WARNING, "Mode change failed: requires position")
            return False
        if number == self.own.auto and not self.mission.total:
            return False
        if self.mode == self.own.auto != number:
            self.mission.leave()
        self.mode, self._since_s = number, self._now_s
        self._enter_mode()
        self._send_heartbeat()
        return True

    def change_speed(self, speed_mps: float) -> bool:
        """Sets the speed (m/s) of the present mode."""
        self._speed_mps = speed_mps
        return True

    def select(self, number: int) -> bool:
        """Makes a mission item the current one; returns whether there is one of that number."""
        found = self.mission.select(number)
        if found:
            self.send(mission_current(self.mission))
            self._fly_mission()
        return found

    def restart_mission(self, number: int) -> bool:
        """Resets the mission and selects an item, as DO_SET_MISSION_CURRENT does with param2 = 1."""
        found = self.mission.restart(number, self.armed and self.mode == self.own.auto)
        if found:
            self._fly_mission()
        return found

    def send_origin(self, home: bool = False) -> None:
        """GPS_GLOBAL_ORIGIN and, if asked for, HOME_POSITION; nothing without an origin."""
        for message in self.estimator.origin_messages()[: 1 + home]:
            self.send(message)

    # ------------------------------------------------------------------ time

    def _tick(self, now_s: float) -> None:
        self._now_s = now_s
        self.estimator.tick(now_s)

    def _is_due(self, name: str, period_s: float) -> bool:
        """Whether `period_s` has passed since this was due last."""
        if self._now_s - self._last_s.get(name, -math.inf) < period_s - 1e-6:
            return False
        self._last_s[name] = self._now_s
        return True

    def _announce_origin(self) -> None:
        for number in range(2):
            self.say(INFO, f"EKF3 IMU{number} origin set")
        self.send_origin(home=True)

    # ------------------------------------------------------------------ output

    def _status(self) -> Status:
        target = self._target
        return Status(
            target_m=None if target is None else (target.north_m, target.east_m),
            is_guided=self.mode == self.own.guided,
            mission=self.mission,
            battery=self.battery,
            has_echo=self.has_echo,
        )

    def _send_heartbeat(self) -> None:
        is_booting = self.own.surface is not None and self.estimator.up_s < BOOT_S
        self._last_s["heartbeat"] = self._now_s
        self.send(self.own.heartbeat(self.mode, self.armed, self.failsafes.is_critical or is_booting))

    def _send_unasked(self) -> None:
        if self._is_due("timesync", TIMESYNC_S):
            self.send(mavlink.MAVLink_timesync_message(0, round(self.estimator.up_s * 1e9) + 1))
        if self._is_due("runtime", RUNTIME_S):
            self.parameters.put(STAT_RUNTIME=float(round(self.estimator.up_s)))
            self._parameter_protocol.send_value("STAT_RUNTIME")
        if not self.armed and self._is_due("ground pressure", GROUND_PRESSURE_S):
            self.parameters.put(BARO1_GND_PRESS=self._last.pressure_pa)
            self._parameter_protocol.send_value("BARO1_GND_PRESS")
        if not self.armed and self.estimator.has_origin and self._is_due("elevation", ELEVATION_S):
            self.say(INFO, "Field Elevation Set: 0m")

    # ------------------------------------------------------------------ modes, targets, missions

    def _enter_mode(self) -> None:
        """Sets the motors and the target for the present mode; clears `_target` and `_speed_mps`."""
        self._target, self._speed_mps = None, math.nan
        if not self.armed:
            return
        if self.mode == self.own.surface:
            self.pilot.order(self._now_s, self.guidance.ascend)
        elif self.mode in (self.own.guided, self.own.auto, self.own.hold):
            self.pilot.order(self._now_s, self.guidance.hold)
        else:
            self.pilot.order(self._now_s, self.guidance.drift)
        if self.mode == self.own.auto:
            self.mission.enter()
            self._fly_mission()

    def _go(self, target: Target) -> None:
        """Flies to a target, if it is armed and no fault is injected."""
        here_m = math.hypot(target.north_m - self._last.north_m, target.east_m - self._last.east_m)
        depth_m = target.depth_m - self.estimator.height_m
        stops = here_m <= STOP_M or (self.own.surface is not None and depth_m <= SURFACE_M)
        if self.fault in (Fault.REFUSES, Fault.IGNORES) or (stops and self.fault is Fault.NEVER_STOPS):
            return
        self._target, self._since_s = target, self._now_s
        if not stops:
            self.pilot.begin_leg((target.north_m, target.east_m))
        self.counts["followed"] += 1
        name = "WPNAV_SPEED" if self.own.surface is not None else "WP_SPEED"
        default_mps = self.parameters[name] * (0.01 if name == "WPNAV_SPEED" else 1.0)
        speed_mps = default_mps if math.isnan(self._speed_mps) else self._speed_mps
        position = np.array([target.north_m, target.east_m, max(depth_m, 0.0)])
        heading_rad = target.heading_rad

        def go(given_s: float) -> None:
            self.guidance.go(given_s, position, heading_rad, speed_mps)

        self.pilot.order(self._now_s, go)

    def _operate(self) -> None:
        """Arms and chooses the mode as its operator does: when the mission begins, and after a failsafe has ended."""
        if self._operator_mode is None or self._now_s - self._failed_s < OPERATOR_S:
            return
        self.arm(True)
        if self.mode == self._operator_mode or self.set_mode(self._operator_mode):
            self._operator_mode = None

    def _step_failsafes(self) -> None:
        response, texts = self.failsafes.step(self._now_s, self.armed)
        for severity, text in texts:
            self.say(severity, text)
        if response is Response.DISARM:
            self.arm(False)
        elif response is Response.SURFACE and self.own.surface is not None:
            self.set_mode(self.own.surface)
        elif response is Response.HOLD:
            self.set_mode(self.own.hold)
        if response in (Response.SURFACE, Response.HOLD):
            self._operator_mode, self._failed_s = self.setup.operator_mode, self._now_s
        rising = self.mode == self.own.surface and self.armed
        if math.isfinite(self._failed_s) and (rising or self.failsafes.is_critical or self.failsafes.leaks):
            self._failed_s = self._now_s
        if rising and self._last.depth_m <= SURFACE_M and self._now_s - self._since_s >= SURFACE_S:
            self.set_mode(self.own.hold)

    def _step_mission(self) -> None:
        item = self.mission.item
        if item is None or self._target is None or self.mode != self.own.auto:
            return
        apart_m = math.hypot(self._target.north_m - self._last.north_m, self._target.east_m - self._last.east_m)
        if apart_m > REACHED_M or self._now_s - self._since_s < REACHED_S:
            return
        self.send(mavlink.MAVLink_mission_item_reached_message(self.mission.current))
        self.say(INFO, self.own.reached_text.format(self.mission.current))
        self.mission.reach()
        if self.mission.state == COMPLETE and self.own.surface is None:
            self.say(INFO, "Mission Complete")
        self._fly_mission()

    def _fly_mission(self) -> None:
        """Flies to the current item of an active mission; other commands than waypoints are passed."""
        if not self.armed or self.mode != self.own.auto:
            return
        while (item := self.mission.item) is not None and item.command != mavlink.MAV_CMD_NAV_WAYPOINT:
            self.mission.reach()
        if item is not None:
            self.say(INFO, f"Mission: {self.mission.current} WP")
            self._go(target_of_item(item, self.estimator.datum))

    def _accept(self, items: Sequence[Message]) -> int:
        if not can_fly(items, self.estimator.datum):
            self.counts["refused"] += 1
            return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
        self.mission.load(tuple(items))
        self.counts["missions"] += 1
        self.parameters.put(MIS_TOTAL=float(len(items)))
        self._parameter_protocol.send_value("MIS_TOTAL")
        self.say(INFO, "Flight plan received")
        if self.own.surface is None and self.mission.state == ACTIVE and self.mode == self.own.auto:
            for _ in range(2):
                self.say(mavlink.MAV_SEVERITY_CRITICAL, "Auto mission changed, restarted command")
            self._fly_mission()
        return int(mavlink.MAV_MISSION_ACCEPTED)

    # ------------------------------------------------------------------ messages

    def _on_heartbeat(self, message: Message) -> None:
        self.failsafes.hear_station(self._now_s, message.get_srcSystem())

    def _on_pilot(self, message: Message) -> None:
        self.failsafes.hear_pilot(self._now_s)

    def _on_position_target(self, message: Message) -> None:
        self.counts["targets"] += 1
        if not (self.armed and self.mode == self.own.guided and self.estimator.has_position):
            return
        try:
            target = target_of_position(message, self.estimator.datum)
        except ValueError:  # the firmware ignores it in silence
            self.counts["refused"] += 1
            return
        self._go(target)

    def _on_set_mode(self, message: Message) -> None:
        if message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            self.set_mode(message.custom_mode)

    def _on_select(self, message: Message) -> None:
        self.select(message.seq)

    def _on_command(self, message: Message) -> None:
        if message.command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            maker = MESSAGES.get(int(message.param1))
            result = mavlink.MAV_RESULT_FAILED if maker is None else mavlink.MAV_RESULT_ACCEPTED
        else:
            maker = None
            command = COMMANDS.get(message.command)
            result = mavlink.MAV_RESULT_UNSUPPORTED
            if command is not None and self.fault is Fault.REFUSES:
                result = mavlink.MAV_RESULT_DENIED
            elif command is not None:
                result = mavlink.MAV_RESULT_ACCEPTED if command(self, message) else mavlink.MAV_RESULT_FAILED
        sender = message.get_srcSystem(), message.get_srcComponent()
        self.send(mavlink.MAVLink_command_ack_message(message.command, result, 0, 0, *sender))
        if maker is not None:
            maker(self)

    def _on_set_origin(self, message: Message) -> None:
        if self.estimator.uses_gps:
            if not self.estimator.has_origin:
                self.say(WARNING, "EKF3 refusing set origin")
            return
        if not self.estimator.has_origin:
            self.estimator.take(Origin(lat_deg=message.latitude * 1e-7, lon_deg=message.longitude * 1e-7))
            self._announce_origin()

    def _on_timesync(self, message: Message) -> None:
        if message.tc1 == 0:
            self.send(mavlink.MAVLink_timesync_message(round(self.estimator.up_s * 1e9), message.ts1))


#: Handler of each message; others are ignored.
HANDLERS: dict[str, Callable[[ArduPilot, Message], None]] = {
    "HEARTBEAT": ArduPilot._on_heartbeat,
    "MANUAL_CONTROL": ArduPilot._on_pilot,
    "SET_POSITION_TARGET_LOCAL_NED": ArduPilot._on_position_target,
    "SET_MODE": ArduPilot._on_set_mode,
    "MISSION_SET_CURRENT": ArduPilot._on_select,
    "COMMAND_LONG": ArduPilot._on_command,
    "SET_GPS_GLOBAL_ORIGIN": ArduPilot._on_set_origin,
    "TIMESYNC": ArduPilot._on_timesync,
}
