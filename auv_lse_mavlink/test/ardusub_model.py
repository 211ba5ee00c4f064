"""A small model of ArduSub for tests: each position target restarts its trajectory from rest, also a repeated one.

Numbers are those of ArduSub 4.5-dev in its own simulator (SITL): `test_the_model_is_as_slow_as_ardusub` compares them.
"""

import math

from pymavlink.dialects.v20 import common as mavlink

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_mavlink.link import VehicleLink
from auv_lse_mavlink.messages import events
from auv_lse_mavlink.messages.datum import Datum, Origin

ORIGIN = Origin(lat_deg=46.5, lon_deg=6.6)
NOW_S = 1_700_000_000.0
MANUAL, GUIDED, AUTO, SURFACE = 19, 4, 3, 9
NO_MISSION, NOT_STARTED, ACTIVE, COMPLETE = 1, 2, 3, 5
#: Speed (m/s) without a command, share of it that is reached, and how fast it is reached after a restart (s).
DEFAULT_MPS, REACHED, RISE_S = 1.0, 0.88, 0.85
STEP_S = 0.1
#: A mission's item is reached within this distance (m).
PASSED_M = 1.0
AIR_HPA = 1013.25


class ArduSub:
    """ArduSub with its vehicle: a straight line in three dimensions to its target; and the link to it.

    Attributes:
        received: Messages of the link, each with its time (s since the start).
        reported: Events of the link.
    """

    def __init__(
        self, link=True, autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, kind=12, feedback=True, origin=ORIGIN, **values
    ):
        self.mav = mavlink.MAVLink(None, srcSystem=2, srcComponent=1)
        self.reader = mavlink.MAVLink(None)
        self.reader.robust_parsing = True
        config = LinkConfig(kind="mavlink", **{"pressure": "none", **values})
        self.link = VehicleLink(config, 2, origin) if link else None
        self.autopilot, self.kind, self.feedback = autopilot, kind, feedback
        self.own_origin, self.now_s, self.booted_s = ORIGIN, NOW_S, NOW_S - 100.0
        self.armed, self.mode = False, MANUAL
        self.position = [0.0, 0.0, 0.0]  # true: north, east of ORIGIN, depth (m)
        self.yaw, self.speed = 0.0, 0.0
        self.received, self.reported = [], []
        self.silent = self.deaf = False
        self.items, self.incoming, self.wanted = [], [], 0
        self.current, self.mission_state = 0, NO_MISSION
        self.forget()

    # ------------------------------------------------------------------ what a test does to it

    def forget(self):
        """Loses target and speed, as on entering GUIDED."""
        self.target, self.begun_s, self.wanted_mps = None, NOW_S, DEFAULT_MPS

    def reboot(self):
        """Restarts: disarmed in MANUAL, without target and time."""
        self.booted_s = self.now_s
        self.armed, self.mode = False, MANUAL
        self.forget()
        self.say(self.heartbeat())
        return self

    def arm(self, armed=True):
        self.armed = armed
        self.forget()
        self.say(self.heartbeat())
        return self

    def enter(self, mode):
        self.mode = mode
        self.forget()
        if mode == AUTO and self.mission_state == NOT_STARTED:
            self.mission_state = ACTIVE
        self.say(self.heartbeat())
        return self

    def ready(self, mode=GUIDED):
        """Armed, in the mode, at its origin, and known to the link."""
        self.run(1.0)
        self.say_origin()
        self.arm().enter(mode)
        self.run(1.0)
        return self

    # ------------------------------------------------------------------ time

    def run(self, seconds, until=lambda: False):
        """Lets time pass, at most until the condition; returns the time it took (s)."""
        began_s = self.now_s
        for number in range(1, round(seconds / STEP_S) + 1):
            self.now_s += STEP_S
            self.move()
            if number % 5 == 0 and not self.silent:
                self.telemetry()
            if number % 10 == 0:
                self.say(self.heartbeat())
            if self.link is not None:
                self.link.poll(self.now_s)
                self.take(self.link.outgoing())
            if until():
                break
        return self.now_s - began_s

    def move(self):
        self.speed = 0.0
        if not self.armed or self.mode not in (GUIDED, AUTO, SURFACE):
            return
        if self.mode == SURFACE:
            self.position[2] = max(0.0, self.position[2] - 1.3 * STEP_S)
            return
        self.fly_mission()
        if self.target is None:
            return
        step = [t - p for t, p in zip(self.target, self.position, strict=True)]
        far_m = math.hypot(*step)
        since_s = self.now_s - self.begun_s
        self.speed = min(self.wanted_mps * REACHED * (1.0 - math.exp(-((since_s / RISE_S) ** 2))), far_m / STEP_S)
        if far_m > 0.0:
            self.position = [p + s / far_m * self.speed * STEP_S for p, s in zip(self.position, step, strict=True)]

    def fly_mission(self):
        if self.mode != AUTO or self.mission_state != ACTIVE:
            return
        if self.target is None:
            self.go(self.items[self.current])
        elif math.dist(self.target, self.position) < PASSED_M:
            if self.current + 1 < len(self.items):
                self.current += 1
                self.go(self.items[self.current])
            else:
                self.mission_state = COMPLETE

    def go(self, target):
        self.target, self.begun_s = target, self.now_s

    # ------------------------------------------------------------------ what it sends

    def say(self, message):
        if self.silent:
            return
        data = message.pack(self.mav)
        self.mav.seq = (self.mav.seq + 1) % 256
        if self.link is not None:
            self.link.receive(self.now_s, data)
            self.take(self.link.outgoing())

    @property
    def boot_ms(self):
        return round((self.now_s - self.booted_s) * 1000.0)

    def heartbeat(self):
        flags = 81 | mavlink.MAV_MODE_FLAG_SAFETY_ARMED * self.armed
        return mavlink.MAVLink_heartbeat_message(self.kind, self.autopilot, flags, self.mode, 4, 3)

    def say_origin(self):
        lat, lon = round(self.own_origin.lat_deg * 1e7), round(self.own_origin.lon_deg * 1e7)
        self.say(mavlink.MAVLink_gps_global_origin_message(lat, lon, 0, 0))

    def telemetry(self):
        datum = Datum(ORIGIN, self.own_origin)
        x, y = datum.to_local_ned(*self.position[:2])
        lat, lon = datum.to_geodetic(*self.position[:2])
        z = self.position[2]
        step = [t - p for t, p in zip(self.target or self.position, self.position, strict=True)]
        far_m = math.hypot(*step) or 1.0
        velocity = [s / far_m * self.speed for s in step]
        self.say(mavlink.MAVLink_attitude_message(self.boot_ms, 0, 0, self.yaw, 0, 0, 0))
        self.say(mavlink.MAVLink_local_position_ned_message(self.boot_ms, x, y, z, *velocity))
        self.say(mavlink.MAVLink_global_position_int_message(self.boot_ms, lat, lon, 0, round(-1000 * z), 0, 0, 0, 0))
        self.say(mavlink.MAVLink_scaled_pressure2_message(self.boot_ms, AIR_HPA + 98.0665 * z, 0.0, 1000))
        if self.feedback:
            self.say(mavlink.MAVLink_nav_controller_output_message(0, 0, 0, 0, int(math.hypot(*step[:2])), 0, 0, 0))
        if self.items:
            self.say_mission_state()

    def say_mission_state(self):
        count = len(self.items) - 1
        self.say(mavlink.MAVLink_mission_current_message(self.current, count, self.mission_state, 0))

    # ------------------------------------------------------------------ what it receives

    def take(self, datagrams):
        self.reported += self.link.events() if self.link is not None else []
        for message in [m for datagram in datagrams for m in self.reader.parse_buffer(datagram) or ()]:
            self.received.append((self.now_s - NOW_S, message))
            if not self.deaf:
                getattr(self, f"on_{message.get_type().lower()}", lambda message: None)(message)

    def on_set_position_target_local_ned(self, message):
        if self.armed and self.mode == GUIDED:
            position = Datum(ORIGIN, self.own_origin).from_local_ned(message.x, message.y)
            self.yaw = message.yaw
            self.go([*position, message.z])

    def on_command_long(self, message):
        if message.command == mavlink.MAV_CMD_DO_CHANGE_SPEED and self.mode in (GUIDED, AUTO):
            self.wanted_mps = message.param2
            self.say(mavlink.MAVLink_command_ack_message(message.command, 0))
        if message.command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            self.say_origin()
        if message.command == mavlink.MAV_CMD_DO_SET_MISSION_CURRENT:
            self.current = int(message.param1)
            is_flown = self.mode == AUTO and (message.param2 == 1.0 or self.mission_state == ACTIVE)
            self.mission_state, self.target = ACTIVE if is_flown else NOT_STARTED, None
            self.say(mavlink.MAVLink_command_ack_message(message.command, 0))
            self.say_mission_state()

    def on_mission_count(self, message):
        self.incoming, self.wanted = [], message.count
        self.say(mavlink.MAVLink_mission_request_message(245, 191, 0))

    def on_mission_item_int(self, message):
        if message.seq != len(self.incoming):
            return
        position = Datum(ORIGIN).from_geodetic(message.x, message.y)
        self.incoming.append([*position, -message.z])
        if len(self.incoming) < self.wanted:
            self.say(mavlink.MAVLink_mission_request_message(245, 191, len(self.incoming)))
            return
        self.items = self.incoming
        self.mission_state = NOT_STARTED if self.mission_state == NO_MISSION else self.mission_state
        self.say(mavlink.MAVLink_mission_ack_message(245, 191, 0))

    def on_mission_set_current(self, message):
        self.current, self.target = message.seq, None
        if self.mission_state == COMPLETE:
            self.mission_state = NOT_STARTED
        self.say_mission_state()

    # ------------------------------------------------------------------ what it has received

    def targets(self, since_s=0.0):
        """Times (s) and positions (north, east, depth in its own frame) of the position targets."""
        kind = "SET_POSITION_TARGET_LOCAL_NED"
        return [(t, (m.x, m.y, m.z)) for t, m in self.received if m.get_type() == kind and t >= since_s]

    def speeds(self, since_s=0.0):
        """The speeds (m/s) commanded."""
        kind = mavlink.MAV_CMD_DO_CHANGE_SPEED
        found = [(t, m) for t, m in self.received if m.get_type() == "COMMAND_LONG" and m.command == kind]
        return [round(m.param2, 2) for t, m in found if t >= since_s]

    @property
    def elapsed_s(self):
        return self.now_s - NOW_S

    def problems(self):
        return [event.text for event in self.reported if isinstance(event, events.Problem)]
