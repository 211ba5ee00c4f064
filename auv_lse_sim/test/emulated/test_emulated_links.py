"""The emulated hardware between a real world and real drivers, in one process and without ROS."""

import math
import time

import pytest
from bench_of_autopilot import FLAT_GROUND, free_udp_port

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.settings import Settings
from auv_lse_comms.micromodem.events import PacketReceived, ReceptionFailed
from auv_lse_comms.micromodem.port import ModemPort
from auv_lse_comms.micromodem.state import State
from auv_lse_comms.transport import UdpPort
from auv_lse_mavlink.link import LinkState, VehicleLink
from auv_lse_mavlink.messages.conversion import Target
from auv_lse_mavlink.messages.events import AutopilotEstimate
from auv_lse_sim.emulated.autopilots import autopilot_for
from auv_lse_sim.emulated.links import EmulatedLinks
from auv_lse_sim.water.channel import Arrival
from auv_lse_sim.world import World

TEAM = (1, 2, 3)


def settings_with(**overrides) -> Settings:
    quiet = {"mission.vehicles": len(TEAM), "sim.ideal": True, "sim.channel.fading_db": 0.0}
    quiet["sim.autopilot.firmware"] = "generic"  # its legs can be compared with the planner's
    return Settings.load(None, {**quiet, **overrides})


class Follower:
    """Vehicles that hand on their legs."""

    def __init__(self, command):
        self.command = command

    def obey(self, k, stop):
        pass

    def dive(self, k, depth_m):
        pass


class Sea:
    """A world with emulated hardware, and the drivers of the vehicles; one tick is a second."""

    def __init__(self, settings: Settings):
        self.settings = settings
        self.world = World.of(settings, FLAT_GROUND)
        self.pending = []
        self.legs = []
        self.links = EmulatedLinks(settings, self.transmit, Follower(self.follow))
        self.ports = {k: ModemPort(settings.vehicle(k).modem, k) for k in self.links.modems}
        self.ears = {}
        self.autopilots = {}
        for k in self.links.autopilots:
            config = settings.vehicle(k).link
            self.ears[k] = UdpPort("udpin", "127.0.0.1", int(config.endpoint.rsplit(":", 1)[1]))
            self.autopilots[k] = VehicleLink(config, k, None)
        self.events = []
        self.outputs = {}
        self.now_s = 0.0

    def transmit(self, k, start_s, payload):
        self.pending.append((start_s, k, payload))
        return self.world.channel.duration_s(len(payload))

    def follow(self, k, leg):
        self.legs.append((k, leg))
        self.world.command(k, leg)

    def tick(self):
        for start_s, k, payload in sorted(self.pending):
            self.world.transmit(k, start_s, payload)
        self.pending.clear()
        self.now_s += 1.0
        self.links.poll(self.now_s)
        self.outputs = self.world.tick(self.now_s)
        for k, output in self.outputs.items():
            for arrival in output.arrivals:
                self.links.arrive(self.now_s, k, arrival)
            if k in self.links.autopilots:
                self.links.report(k, self.now_s, output)

    def carry(self):
        self.links.serve(self.now_s)
        for k, port in self.ports.items():
            self.events += [(k, event) for event in port.step(self.now_s, time.monotonic())]
        for k, link in self.autopilots.items():
            link.receive(self.now_s, self.ears[k].read())
            link.poll(self.now_s)
            self.events += [(k, event) for event in link.events()]
            for datagram in link.outgoing():
                self.ears[k].write(datagram)

    def until(self, condition, what):
        end = time.monotonic() + 20.0
        while not condition():
            assert time.monotonic() < end, what
            self.carry()
            time.sleep(0.0005)

    def of(self, kind):
        return [(k, event) for k, event in self.events if isinstance(event, kind)]

    def close(self):
        for port in self.ports.values():
            port.close(self.now_s, time.monotonic())
        for ear in self.ears.values():
            ear.close()
        self.links.close()


@pytest.fixture
def emulated(tmp_path):
    overrides = {}
    for k in TEAM:
        overrides[f"auv{k}.modem.kind"] = "micromodem"
        overrides[f"auv{k}.modem.port"] = str(tmp_path / f"auv{k}")
        overrides[f"auv{k}.link.kind"] = "mavlink"
        overrides[f"auv{k}.link.endpoint"] = f"udpin://127.0.0.1:{free_udp_port()}"
    sea = Sea(settings_with(**overrides))
    yield sea
    sea.close()


def test_packets_go_through_the_channel_as_without_modems(emulated):
    sea = emulated
    sea.until(lambda: all(p.modem.state is State.IDLE for p in sea.ports.values()), "the modems were not configured")
    direct = World.of(sea.settings, FLAT_GROUND)
    expected = []
    for number in range(30):
        k = TEAM[number // 10]
        payload = bytes([number]) * 252
        if number % 10 == 0:
            sea.ports[k].send(sea.now_s, payload, 0)
            sea.until(lambda: sea.pending, "the packet did not reach the water")
            direct.transmit(k, sea.now_s, payload)
        sea.tick()
        sea.until(
            lambda: all(p.modem.counts["received"] == sea.links.delivered(v) for v, p in sea.ports.items()),
            "not everything was handed over",
        )
        for output in direct.tick(sea.now_s).values():
            expected += output.arrivals
    got = sorted((k, e.source, e.payload, e.utc_s, e.snr_db) for k, e in sea.of(PacketReceived))
    want = sorted((a.receiver, a.source, a.payload, a.arrival_s, a.snr_db) for a in expected)
    assert len(got) == len(want) == 6
    for a, b in zip(got, want, strict=True):
        assert a[:3] == b[:3]
        assert a[3] == pytest.approx(b[3], abs=1.1e-4)
        assert a[4] == pytest.approx(b[4], abs=0.051)


def test_what_is_heard_but_not_read_is_reported_as_a_failed_reception(emulated):
    sea = emulated
    sea.until(lambda: sea.ports[2].modem.state is State.IDLE, "the modem was not configured")
    lost = Arrival(
        receiver=2,
        source=1,
        payload=bytes(252),
        sent_s=0.0,
        start_s=0.1,
        arrival_s=2.1,
        snr_db=-5.0,
        range_m=150.0,
        ok=False,
        why="noise",
    )
    sea.links.arrive(sea.now_s, 2, lost)
    sea.until(lambda: sea.of(ReceptionFailed), "no failed reception was reported")
    assert sea.of(ReceptionFailed)[0][1].reason == "bad CRC"
    assert sea.links.delivered(2) == 0


def test_a_vehicle_travels_to_its_targets_and_its_odometry_comes_back(emulated):
    sea = emulated
    sea.links.send_on_deck(0.0)
    sea.until(lambda: all(a.state is LinkState.UP for a in sea.autopilots.values()), "no autopilot was heard")
    vehicle = sea.settings.vehicle(1).vehicle
    north, east = vehicle.start_north_m, vehicle.start_east_m
    heading = vehicle.start_heading_rad
    target = Target(
        north_m=north + 60.0 * math.cos(heading),
        east_m=east + 60.0 * math.sin(heading),
        depth_m=vehicle.depth_m,
        heading_rad=heading,
    )
    sea.autopilots[1].command(0.0, target)
    sea.until(lambda: sea.legs, "the target was not taken")
    assert sea.links.accepted(1)[0] >= 1
    for number in range(1, 31):
        sea.tick()
        sea.until(
            lambda number=number: len([1 for k, _ in sea.of(AutopilotEstimate) if k == 1]) == number, "no odometry"
        )
    last = [e for k, e in sea.of(AutopilotEstimate) if k == 1][-1]
    estimate = sea.outputs[1].odometry
    assert (last.north_m, last.east_m) == pytest.approx((estimate.north_m, estimate.east_m), abs=1e-3)
    assert last.stamp_s == 30.0
    # 30 s at 1.5 m/s along the start's heading
    gone = (last.north_m - north) * math.cos(heading) + (last.east_m - east) * math.sin(heading)
    assert gone == pytest.approx(30.0 * vehicle.speed_mps, rel=0.1)


def test_a_target_inside_the_turning_circle_is_turned_to_as_tightly_as_the_vehicle_can(emulated):
    """12 m ahead and 15 m to starboard; by the other circle the leg would be 90 m long."""
    sea = emulated
    sea.links.send_on_deck(0.0)
    sea.until(lambda: all(a.state is LinkState.UP for a in sea.autopilots.values()), "no autopilot was heard")
    vehicle = sea.settings.vehicle(1).vehicle
    heading = vehicle.start_heading_rad
    target = Target(
        north_m=vehicle.start_north_m + 12.0 * math.cos(heading) - 15.0 * math.sin(heading),
        east_m=vehicle.start_east_m + 12.0 * math.sin(heading) + 15.0 * math.cos(heading),
        depth_m=vehicle.depth_m,
        heading_rad=heading,
    )
    sea.autopilots[1].command(0.0, target)
    sea.until(lambda: sea.legs, "the target was not taken")
    ((_, leg),) = sea.legs
    assert leg.radius_m == pytest.approx(12.3, abs=0.01)
    assert leg.length_m < 25.0


def test_without_hardware_there_is_nothing_to_open():
    links = EmulatedLinks(settings_with(), lambda *a: 0.0, Follower(lambda *a: None))
    assert links.modems == links.autopilots == ()
    links.serve(0.0)
    links.poll(0.0)
    links.send_on_deck(0.0)
    assert links.delivered(1) == 0
    assert links.accepted(1) == (0, 0)
    links.close()


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"auv1.modem.kind": "micromodem", "auv1.modem.port": "/dev/ttyUSB0"}, "outside /dev"),
        ({"auv1.modem.kind": "micromodem", "auv1.modem.port": "tcp://10.0.0.1:4001"}, "tcp://127.0.0.1"),
        ({"auv1.link.kind": "mavlink", "auv1.link.endpoint": "udpout://127.0.0.1:14550"}, "use udpin"),
        ({"auv1.link.kind": "mavlink", "auv1.link.endpoint": "udpin://0.0.0.0:14550"}, "use udpin"),
    ],
)
def test_invalid_ports_are_named(overrides, words):
    with pytest.raises(ParameterError, match=words):
        EmulatedLinks(settings_with(**overrides), lambda *a: 0.0, Follower(lambda *a: None))


@pytest.mark.parametrize("firmware", ["generic", "ardupilot"])
def test_a_simulated_autopilot_has_the_component_id_of_the_mission_file(firmware):
    """The link, which hears no other, waited for it in vain."""
    values = {"sim.autopilot.firmware": firmware, "link.autopilot_component_id": 7}
    settings = Settings.load(None, {"mission.vehicles": 1, "auv1.link.kind": "mavlink", **values})
    world = World.of(settings, FLAT_GROUND)
    autopilot = autopilot_for(settings, 1, None, world)
    link = VehicleLink(settings.vehicle(1).link, 1, None)
    autopilot.send_on_deck(0.0)
    link.receive(0.0, b"".join(autopilot.outgoing()))
    assert link.state is LinkState.UP
