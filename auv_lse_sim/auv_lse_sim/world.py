"""The simulated world: ground, water, vehicles and the acoustic channel, advanced in ticks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.sim import SimConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.mission_run import Stop
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_sim.ground.ground import Ground
from auv_lse_sim.vehicle.piloted import Pilot
from auv_lse_sim.vehicle.vehicle import SimVehicle
from auv_lse_sim.vehicle.vehicle_state import NavigationEstimate, Truth
from auv_lse_sim.water.channel import Arrival, Channel, land_between
from auv_lse_sim.water.current import Current
from auv_lse_sim.water.ranging import Ranging

#: Longest time (s) from a packet's start to its last reception: duration and travel time.
LONGEST_TRAVEL_S = 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleOutput:
    """The output of one tick for one vehicle.

    Attributes:
        soundings: Soundings completed in this tick, by time.
        odometry: The vehicle's own estimate at the tick's end.
        dead_reckoning: Its dead reckoning at the tick's end.
        fixes: Fixes completed in this tick, by time.
        altitude_m: Measured altitude above the bottom at the tick's end, NaN without an echo.
        pressure_depth_m: Measured depth of the vehicle below the surface.
        gps_m: North, east of its last GPS reading, if it is at the surface; else None.
        arrivals: Packets that its modem received in this tick, by time.
        truth: Its true state.
    """

    soundings: Soundings
    odometry: NavigationEstimate
    dead_reckoning: DeadReckoning
    fixes: list[Fix]
    altitude_m: float
    pressure_depth_m: float
    arrivals: list[Arrival]
    truth: Truth
    gps_m: tuple[float, float] | None = None


class World:
    """The simulated world outside the vehicles' cores.

    One tick, ending at `now_s`: `tick(now_s)`, then the vehicles' `command` and `transmit` of that tick.

    Random numbers come from named streams of `seed`: ("sensors", k), ("current",), ("channel",) and ("ranging",). The
    number of draws from each depends only on the times and the transmissions.

    Args:
        vehicles: One configuration per vehicle, by number from 1.
        area: Section `area`; a waiting vehicle circles to the side with more room. None: no limits.
    """

    def __init__(
        self, sim: SimConfig, vehicles: Sequence[VehicleConfig], area: AreaConfig | None, ground: Ground, seed: int
    ) -> None:
        self.config = sim
        self.ground = ground
        operating_area = OperatingArea(area) if area is not None else None

        def clearance(north_m: float, east_m: float) -> float:
            assert operating_area is not None
            return float(operating_area.clearance_m(np.array([[north_m, east_m]]))[0])

        self.vehicles = {
            number: SimVehicle(
                number, vehicle, sim, stream(seed, "sensors", number), clearance if operating_area is not None else None
            )
            for number, vehicle in enumerate(vehicles, 1)
        }
        self._current = Current(sim.current, stream(seed, "current"), sim.ideal)
        self.channel = Channel(sim.channel, stream(seed, "channel"), land_between(ground.depth_m))
        self._ranging = Ranging(
            sim.ranging, len(vehicles), sim.channel.sound_speed_mps, stream(seed, "ranging"), sim.ideal
        )
        self._tracks: list[tuple[Array, dict[int, Array]]] = []  # of the last ticks: stamps, true tracks by vehicle
        self._now_s = 0.0
        self._substeps = 0
        self.lost: list[Arrival] = []

    @classmethod
    def of(cls, settings: Settings, ground: Ground) -> World:
        """Builds the world of a mission."""
        vehicles = [own.vehicle for own in settings.vehicles]
        world = cls(settings.sim, vehicles, settings.area, ground, settings.mission.seed)
        for number, own in enumerate(settings.vehicles, 1):
            if own.link.kind == "direct" and own.vehicle.depth_m > 0.0:  # else its autopilot gets lifted targets
                world.vehicles[number].keep_altitude(own.safety.kept_altitude_m(own.vehicle.min_altitude_m))
        return world

    @property
    def now_s(self) -> float:
        """End of the last tick."""
        return self._now_s

    def tick(self, now_s: float) -> dict[int, VehicleOutput]:
        """Advances everything to `now_s`.

        `lost` holds the packets that could not be read, until the next tick.

        Raises:
            ValueError: if time runs backwards.
        """
        start_s = self._now_s
        if now_s < start_s:
            raise ValueError(f"world: cannot tick to {now_s:g} s, which is not after {start_s:g} s")
        # Sub-steps have their own clock, independent of the ticks: these end within this tick.
        rate, done = self.config.dvl.rate_hz, self._substeps
        self._substeps = math.floor(now_s * rate + 1e-6)
        stamps = np.arange(done + 1, self._substeps + 1) / rate
        n = len(stamps)
        currents = self._current.advance(done / rate, stamps)
        positions = [vehicle.move(stamps, currents) for vehicle in self.vehicles.values()]
        north, east = np.concatenate([p[0] for p in positions]), np.concatenate([p[1] for p in positions])
        water = self.ground.depth_m(north, east)
        self._tracks.append((stamps, {number: vehicle.track for number, vehicle in self.vehicles.items()}))
        self._tracks = [entry for entry in self._tracks if len(entry[0]) and entry[0][-1] > now_s - LONGEST_TRAVEL_S]
        arrivals = [self._timed(arrival) for arrival in self.channel.arrivals(now_s)]
        self.lost = [a for a in arrivals if not a.ok]
        self._now_s = now_s
        output: dict[int, VehicleOutput] = {}
        for i, (number, vehicle) in enumerate(self.vehicles.items()):
            soundings = vehicle.sense(water[i * n : (i + 1) * n])
            output[number] = VehicleOutput(
                soundings=Soundings.from_rows(soundings),
                odometry=vehicle.odometry(now_s),
                dead_reckoning=vehicle.dead_reckoning(now_s),
                fixes=vehicle.fixes,
                altitude_m=vehicle.altitude_m,
                pressure_depth_m=vehicle.pressure_depth_m,
                arrivals=[a for a in arrivals if a.ok and a.receiver == number],
                truth=vehicle.truth(now_s),
                gps_m=vehicle.gps_m,
            )
        return output

    def _timed(self, arrival: Arrival) -> Arrival:
        """Adds the measured travel time to an arrival, unless the channel has no delay."""
        source, receiver = (
            self._position(arrival.source, arrival.sent_s),
            self._position(arrival.receiver, arrival.start_s),
        )
        travel_s = self._ranging.travel_s(
            arrival.source, arrival.receiver, arrival.sent_s, float(np.linalg.norm(source - receiver))
        )
        return replace(arrival, travel_s=travel_s if self.channel.config.delay else math.nan)

    def _position(self, vehicle: int, now_s: float) -> Array:
        """True north, east, depth (m) of a vehicle at a time of the last ticks, shape (3,)."""
        stamps = np.concatenate([entry[0] for entry in self._tracks])
        track = np.concatenate([entry[1][vehicle] for entry in self._tracks])
        return np.array([np.interp(now_s, stamps, column) for column in track.T])

    def command(self, vehicle: int, leg: Leg, speed_mps: float | None = None, then: Stop | None = None) -> None:
        """Gives a vehicle its next leg, with the speed (None: its own) and what follows the mission's last leg."""
        self.vehicles[vehicle].command(leg, speed_mps, then)

    def obey(self, vehicle: int, stop: Stop | None) -> None:
        """Makes a vehicle stop, or continue (None)."""
        self.vehicles[vehicle].obey(stop)

    def pilot(self, vehicle: int, pilot: Pilot) -> None:
        """Hands a vehicle over to an autopilot with a trajectory of its own."""
        self.vehicles[vehicle].pilot(pilot)

    def dive(self, vehicle: int, depth_m: float) -> None:
        """Sets the depth (m) at which a vehicle travels."""
        self.vehicles[vehicle].dive(depth_m)

    def transmit(self, vehicle: int, now_s: float, payload: bytes) -> float:
        """Starts a vehicle's transmission; returns its end (s)."""
        return self.channel.transmit(now_s, vehicle, payload, self.positions())

    def positions(self) -> Mapping[int, tuple[float, float, float]]:
        """True north, east and depth (m) of every vehicle."""
        return {number: vehicle.position for number, vehicle in self.vehicles.items()}
