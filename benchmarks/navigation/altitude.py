"""Accuracy of altitude keeping over rising ground: directly simulated, and with a simulated ArduSub.

`auv_lse bench altitude` flies legs over a trapezoid, a sawtooth and steps, and short missions over rough ground. Each
mission has another ground; half of them have an ArduSub.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.safety.altitude_keeper import LAG_S
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.extent import Extent
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_mavlink.messages.datum import Origin
from auv_lse_sim.emulated.autopilot_report import Report
from auv_lse_sim.ground.ground import Ground
from auv_lse_sim.world import VehicleOutput, World
from benchmarks.navigation.lone_vehicle import LoneVehicle
from benchmarks.rows import Row, row

ORIGIN = Origin(lat_deg=46.5, lon_deg=6.6)
#: Requested altitude, travel depth, length of a leg (m), and speed (m/s).
ASKED_M, DEPTH_M, LEG_M, SPEED_MPS = 3.0, 10.0, 23.6, 1.0
#: Seconds until a vehicle has dived.
DIVED_S = 60.0


@dataclass(frozen=True)
class Profile:
    """Ground that varies with north alone.

    Attributes:
        knots_m: North and depth (m) of its corners, shape (k, 2).
    """

    knots_m: tuple[tuple[float, float], ...]
    origin: tuple[float, float] | None = None

    def depth_m(self, north_m: Array, east_m: Array) -> Array:
        """Depth (m) there."""
        north, depth = np.array(self.knots_m).T
        return np.asarray(np.interp(north_m, north, depth) + 0.0 * np.asarray(east_m))

    @property
    def extent(self) -> Extent:
        """Where the depth is known."""
        return Extent(north_min_m=-1e4, north_max_m=1e4, east_min_m=-1e4, east_max_m=1e4)

    def describe(self) -> str:
        """The ground in words."""
        return "profile"


def trapezoid(slope: float) -> Profile:
    """A rise of 5 m, a plateau, and a fall, each with a slope (m/m), after 100 m of ground that is 3.6 m below."""
    run_m, low_m = 5.0 / slope, DEPTH_M + ASKED_M + 0.6
    return Profile(((0.0, low_m), (100.0, low_m), (100.0 + run_m, low_m - 5.0), (140.0 + run_m, low_m - 5.0),
                    (140.0 + 2.0 * run_m, low_m)))  # fmt: skip


def sawtooth(slope: float) -> Profile:
    """Teeth of 4 m, rising with a slope (m/m) and falling within 2 m."""
    run_m, low_m = 4.0 / slope, DEPTH_M + ASKED_M + 0.6
    knots, north_m = [(0.0, low_m), (100.0, low_m)], 100.0
    for _ in range(4):
        knots += [(north_m + run_m, low_m - 4.0), (north_m + run_m + 2.0, low_m)]
        north_m += run_m + 22.0
        knots.append((north_m, low_m))
    return Profile(tuple(knots))


def steps() -> Profile:
    """Three steps of 1.5 m up, 30 m apart, the first where the vehicle is 3 m above the ground."""
    height_m, low_m, knots = 1.5, DEPTH_M + ASKED_M, [(0.0, DEPTH_M + ASKED_M)]
    for k in range(3):
        north_m = 100.0 + 30.0 * k
        knots += [(north_m, low_m - k * height_m), (north_m + 0.1, low_m - (k + 1) * height_m)]
    return Profile(tuple(knots))


def rough(rng: np.random.Generator) -> Profile:
    """Rough ground: slopes of up to 0.2, humps, and a step now and then."""
    knots, north_m, depth_m = [(0.0, 18.0), (60.0, 18.0)], 60.0, 18.0
    while north_m < 700.0:
        if rng.random() < 0.1:
            run_m, change_m = 0.3, rng.uniform(-1.5, 1.5)
        else:
            run_m = rng.uniform(3.0, 30.0)
            change_m = run_m * rng.uniform(-0.2, 0.2)
        north_m, depth_m = north_m + run_m, min(max(depth_m + change_m, 6.0), 22.0)
        knots.append((north_m, depth_m))
    return Profile(tuple(knots))


def _parameters(seed: int) -> dict[str, Any]:
    return {
        "mission.seed": seed,
        "auv1.vehicle.depth_m": DEPTH_M,
        "auv1.vehicle.speed_mps": SPEED_MPS,
        "auv1.vehicle.min_altitude_m": ASKED_M,
    }


def direct(ground: Ground, length_m: float, seed: int) -> Iterator[VehicleOutput]:
    """Travels north without an autopilot; yields each second's output."""
    values = {"mission.vehicles": 1, "sim.current.ideal": True, **_parameters(seed)}
    world = World.of(Settings.load(None, values), ground)
    legs = [
        Leg(step=k, heading_rad=0.0, north_m=LEG_M * k, east_m=0.0, action_rad=0.0, radius_m=15.0, straight_m=LEG_M)
        for k in range(math.ceil(length_m / LEG_M))
    ]
    now_s, step = 0.0, -1
    while now_s < 3.0 * length_m / SPEED_MPS:
        now_s += 1.0
        output = world.tick(now_s)[1]
        yield output
        if output.truth.north_m >= length_m:
            return
        if output.truth.step == step and step + 1 < len(legs):  # the leg after this one
            step += 1
            world.command(1, legs[step])


def late_altitudes() -> Callable[[float, Report], Report]:
    """Makes an autopilot report each altitude `LAG_S` late."""
    last_m = math.nan

    def delay(now_s: float, report: Report) -> Report:
        nonlocal last_m
        before_m, last_m = last_m, report.altitude_m
        return replace(report, altitude_m=LAG_S * before_m + (1.0 - LAG_S) * last_m)

    return delay


def with_autopilot(ground: Ground, length_m: float, seed: int) -> Iterator[VehicleOutput]:
    """Travels north with a simulated ArduSub; yields each second's output."""
    lone = LoneVehicle(ground, ORIGIN, _parameters(seed))
    lone.distort = late_altitudes()
    step = 0
    lone.leg(step, LEG_M)
    while lone.now_s < 4.0 * length_m / SPEED_MPS:
        output = lone.tick()
        yield output
        if output.truth.north_m >= length_m:
            return
        if len(lone.link.targets) < 2:
            step += 1
            lone.leg(step, LEG_M)


Flight = Callable[[Ground, float, int], Iterator[VehicleOutput]]
FLIGHTS: dict[str, Flight] = {"direct": direct, "ArduSub": with_autopilot}


@dataclass(frozen=True)
class Result:
    """Result of one flight.

    Attributes:
        least_m: Smallest true altitude, after the dive.
        depth_m: Depth at the end.
        speed_mps: Mean speed over ground, after the dive.
        finished: Whether it came to the end.
    """

    least_m: float
    depth_m: float
    speed_mps: float
    finished: bool


def fly(flight: Flight, ground: Ground, length_m: float, seed: int = 1) -> Result:
    """Flies over ground to `length_m` north."""
    rows = [
        (o.truth.stamp_s, o.truth.north_m, o.truth.depth_m, o.truth.water_m) for o in flight(ground, length_m, seed)
    ]
    stamp, north, depth, water = np.array(rows).T
    late = stamp > DIVED_S
    speed_mps = float((north[-1] - north[late][0]) / (stamp[-1] - stamp[late][0]))
    return Result(float((water - depth)[late].min()), float(depth[-1]), speed_mps, bool(north[-1] >= length_m))


def run(smoke: bool = False, missions: int = 300) -> list[Row]:
    """The figures of all grounds and both kinds of vehicle."""
    grounds = {"steps of 1.5 m": steps()}
    if not smoke:
        grounds |= {"trapezoid 0.15": trapezoid(0.15), "sawtooth 0.15": sawtooth(0.15)}
    rows = []
    for kind, flight in FLIGHTS.items():
        for name, ground in grounds.items():
            goal_m = 1.0 if "steps" in name else 0.9 * ASKED_M
            least_m = fly(flight, ground, 250.0).least_m
            rows.append(
                row(f"{name}, {kind}: least altitude", least_m, "m", goal=f">= {goal_m:g}", holds=least_m >= goal_m)
            )
    missions = 2 if smoke else missions
    leasts, touched = [], 0
    for number in range(missions):
        flight = FLIGHTS["direct" if number % 2 else "ArduSub"]
        least_m = fly(flight, rough(np.random.default_rng(number)), 150.0 if smoke else 600.0, number).least_m
        leasts.append(least_m)
        touched += least_m <= 0.0
    rows.append(row(f"{missions} missions on rough ground: with contact", touched, goal="0", holds=touched == 0))
    rows.append(row("their least altitude", min(leasts), "m"))
    return rows
