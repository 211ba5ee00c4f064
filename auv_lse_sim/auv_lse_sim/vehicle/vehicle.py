"""One simulated vehicle: follows its legs, measures the depth, and navigates by its instruments."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from auv_lse_common.mission_file.sections.sim import SimConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.mission_run import Action, Stop
from auv_lse_sim.vehicle import motion_model as mm
from auv_lse_sim.vehicle.echo_sounder import EchoSounder
from auv_lse_sim.vehicle.kept_altitude import KeptAltitude
from auv_lse_sim.vehicle.motion_parameters import DEG, initial_model, speed_share
from auv_lse_sim.vehicle.navigation import DVL_SCALE, EAST, HEADING, NORTH, SURGE, SWAY, wrap
from auv_lse_sim.vehicle.piloted import Pilot, advance_piloted
from auv_lse_sim.vehicle.records import LEG, NORMALS, RESULT, UNIFORMS, Draws, as_records, columns, new_record
from auv_lse_sim.vehicle.target_leg import leg_to
from auv_lse_sim.vehicle.vehicle_state import NavigationEstimate, Truth

#: A leg that starts within these limits of the last leg's end continues it.
SEAM_M = 0.5
SEAM_RAD = 5.0 * DEG
#: An ideal vehicle within this distance of a leg's start is on the leg (plans are rounded to 32 bits).
RAILS_M = 0.01
#: Depth control ignores smaller changes (m) of the travel depth: they are noise in the commands.
DEPTH_BAND_M = 0.1
#: Smaller turns count as straight: MAVLink's rounding to centimetres turns a straight by up to half of this.
NO_TURN_RAD = 1e-3
#: Rows and columns of the covariance in odometry.
_ODOMETRY = np.ix_((HEADING, NORTH, EAST), (HEADING, NORTH, EAST))


def tightest_radius_m(vehicle: VehicleConfig, sim: SimConfig) -> float:
    """Minimum turn radius (m) of a vehicle."""
    return vehicle.speed_mps / (sim.dynamics.turn_rate_max_dps * DEG)


@dataclass(frozen=True, slots=True)
class _Order:
    """A leg, the speed (m/s) through the water, and the stop after the mission's last leg."""

    leg: Leg
    speed_mps: float
    then: Stop | None


@dataclass(frozen=True, slots=True)
class _Interrupted:
    """The leg that a stop has interrupted, and the orders received since then."""

    leg: Any
    step: int
    along_m: float
    loitering: bool
    then: Stop | None
    orders: list[_Order]


class SimVehicle:
    """A simulated vehicle.

    Each tick calls `move`, which returns the positions of the sub-steps, then `sense` with the true water depth there.

    A new leg starts at the end of the current leg if it begins there, otherwise at once. Without a next leg the vehicle
    circles at the leg's turning radius from the leg's end; when a leg arrives, it turns at once to the end of that leg,
    or, on rails (ideal motion), starts it when the circle closes. On a stop (`obey`) it circles, surfaces or goes to a
    position; then it steers back to its leg and takes the legs received meanwhile.

    Args:
        number: Its number, from 1.
        config: Its depth, speed and start.
        rng: Source of all its random numbers (stream "sensors", number).
        clearance_m: Returns the clearance (m) at north, east (m); selects the side on which to circle.
    """

    def __init__(
        self,
        number: int,
        config: VehicleConfig,
        sim: SimConfig,
        rng: np.random.Generator,
        clearance_m: Callable[[float, float], float] | None = None,
    ) -> None:
        """Draws the instruments' biases; the vehicle waits at its start."""
        self.number = number
        self.config = config
        self._sim = sim
        self._rng = rng
        more = rng.spawn(1)[0]  # does not change the draws of `rng`
        self._clearance_m = clearance_m
        draws = rng.standard_normal(8)
        self._travel_m = config.depth_m
        self._altitude, self._kept_m = KeptAltitude(0.0), math.inf  # the keeper, and the depth that it allows
        self._model = initial_model(config, sim, more, draws)
        self._rails = bool(self._params.ideal_motion and self._params.ideal_navigation)
        self._speed_share = speed_share(sim, draws)
        self._sounder = EchoSounder(sim, rng, float(draws[4]))
        self._leg = new_record(LEG, 0.0, 0.0, 0.0, 0.0, 15.0)
        self._step = -1
        self._next: _Order | None = None
        self._then: Stop | None = None
        self._stop: Stop | None = None
        self._interrupted: _Interrupted | None = None
        self._loitering = False
        self._surface_after = False
        self._pilot: Pilot | None = None
        self._results = columns(np.empty(0, RESULT))
        self._stamps = np.empty(0)
        #: Fixes completed in the last `move`.
        self.fixes: list[Fix] = []

    @property
    def _m(self) -> Any:
        return self._model.state

    @property
    def _params(self) -> Any:
        return self._model.params

    @property
    def _x(self) -> Array:
        return self._model.estimate.x

    @property
    def _p(self) -> Array:
        return self._model.estimate.p

    @property
    def step(self) -> int:
        """Step at which its leg starts; -1 before the first leg."""
        return self._step

    @property
    def position(self) -> tuple[float, float, float]:
        """True north, east and depth (m)."""
        return float(self._m.north), float(self._m.east), float(self._m.depth)

    @property
    def state(self) -> Array:
        """The filter's state (10,), see `navigation`."""
        return self._x.copy()

    @property
    def covariance(self) -> Array:
        """The filter's covariance (10, 10)."""
        return self._p.copy()

    @property
    def error(self) -> Array:
        """The filter's state minus the truth (10,)."""
        m = self._m
        seen = 1.0 + m.dvl_scale
        truth = np.array(
            [m.north, m.east, m.heading, seen * m.surge, seen * m.sway, m.gyro_bias,
             m.compass_bias, m.dvl_scale, m.compass_sin, m.compass_cos]
        )  # fmt: skip
        error: Array = self._x - truth
        error[HEADING] = wrap(error[HEADING])
        return error

    @property
    def track(self) -> Array:
        """True north, east, depth (m) of the sub-steps of the last `move`, shape (n, 3)."""
        return np.column_stack([self._results.north, self._results.east, self._results.depth])

    def command(self, leg: Leg, speed_mps: float | None = None, then: Stop | None = None) -> None:
        """Begins the next leg.

        Args:
            speed_mps: Speed through the water; None: the configured one.
            then: The stop after the mission's last leg; None: it circles.
        """
        self._take(_Order(leg, self.config.speed_mps if speed_mps is None else speed_mps, then))

    def pilot(self, pilot: Pilot) -> None:
        """Hands the vehicle over to an autopilot with a trajectory of its own; legs and stops have no effect then."""
        self._pilot = pilot
        self._m.mode = mm.PILOTED

    def dive(self, depth_m: float) -> None:
        """Sets the travel depth (m); a change below `DEPTH_BAND_M` is ignored."""
        if abs(depth_m - self._travel_m) > DEPTH_BAND_M:
            self._travel_m = depth_m
            self._keep_depth()

    def obey(self, stop: Stop | None) -> None:
        """Stops as requested; None: continues."""
        if stop == self._stop:
            return
        self._stop = stop
        self._keep_depth()
        if self._m.mode == mm.WAITING:
            return
        if stop is None:
            self._resume()
            return
        if self._interrupted is None:
            orders = [] if self._next is None else [self._next]
            along_m = float(self._m.along)
            self._interrupted = _Interrupted(self._leg.copy(), self._step, along_m, self._loitering, self._then, orders)
        self._next, self._then = None, None
        here = self._here()
        if stop.action is Action.GO_TO:
            self._lead(leg_to(*here, stop.position_m, float(self._leg.radius), self._step))
        else:
            self._leg = new_record(LEG, *here, 0.0, float(self._leg.radius), 0.0)
            self._circle(0.0)

    def _resume(self) -> None:
        way, self._interrupted = self._interrupted, None
        if way is None:
            return
        self._leg, self._step, self._loitering, self._then = way.leg, way.step, way.loitering, way.then
        self._m.along = way.along_m
        self._m.mode = mm.STEERED
        for order in way.orders:
            self._take(order)

    def _take(self, order: _Order) -> None:
        if self._interrupted is not None:
            self._interrupted.orders.append(order)
        elif self._m.mode == mm.WAITING or self._follows(order.leg):
            self._next = order
        elif self._loitering and self._m.mode == mm.STEERED:
            self._next = None
            self._begin(replace(order, leg=self._from_here(order.leg)), 0.0)
        else:
            self._next = None
            self._begin(order, 0.0)

    def _here(self) -> tuple[float, float, float]:
        """Heading, north, east for unplanned legs: on rails those of the track, else the estimate."""
        if self._m.mode == mm.ON_RAILS:
            heading, north, east, _ = mm.on_leg(self._leg, self._m.along)
            return heading, north, east
        return float(self._x[HEADING]), float(self._x[NORTH]), float(self._x[EAST])

    def _from_here(self, leg: Leg) -> Leg:
        """A leg from the vehicle to the end of `leg`, whose start it has passed."""
        _, north, east = leg.end_state
        tightest_m = tightest_radius_m(self.config, self._sim)
        way = leg_to(*self._here(), (float(north), float(east)), leg.radius_m, leg.step, tightest_m)
        return replace(way, surface=leg.surface)

    def _keep_depth(self) -> None:
        up = self._stop is not None and self._stop.action is Action.SURFACE
        self._params.depth = 0.0 if up else min(self._travel_m, self._kept_m)

    def _lead(self, leg: Leg, along_m: float = 0.0) -> None:
        """Sets the current leg."""
        self._leg = new_record(
            LEG, leg.heading_rad, leg.north_m, leg.east_m, leg.action_rad, leg.radius_m, leg.straight_m
        )
        self._loitering = False
        self._m.along = along_m

    def _follows(self, leg: Leg) -> bool:
        """Whether a leg begins at the end of the current one; a steered circle has no end."""
        if self._loitering and self._m.mode == mm.STEERED:
            return False
        start = (self._leg.heading, self._leg.north, self._leg.east)
        end = start if self._loitering else mm.on_leg(self._leg, mm.leg_length(self._leg))
        near = math.hypot(leg.north_m - end[1], leg.east_m - end[2]) <= SEAM_M
        return near and abs(wrap(leg.heading_rad - end[0])) <= SEAM_RAD

    def _begin(self, order: _Order, along_m: float) -> None:
        """Starts a leg, `along_m` from its beginning."""
        m, leg = self._m, order.leg
        self._surface()
        self._surface_after = leg.surface
        self._params.speed = order.speed_mps * self._speed_share
        self._then = order.then
        self._keep_depth()
        on_track = mm.on_leg(self._leg, m.along) if m.mode == mm.ON_RAILS else None
        self._lead(leg, along_m)
        self._step = leg.step
        position = mm.on_leg(self._leg, along_m)
        on_rails = self._rails and math.hypot(position[1] - m.north, position[2] - m.east) < RAILS_M
        if on_track is None and m.mode != mm.WAITING and abs(wrap(position[0] - m.heading)) > 0.01:
            on_rails = False
        m.mode = mm.ON_RAILS if on_rails else mm.STEERED

    def _surface(self) -> None:
        """Starts surfacing for a fix if the ending leg requests it."""
        if self._surface_after and self._m.surfacing == mm.NOT_SURFACING:
            self._m.surfacing, self._m.under_way = mm.TO_SURFACE, 0.0
        self._surface_after = False

    def _end(self, along_m: float) -> None:
        """Handles the end of a leg without a successor; `along_m` of what follows is already travelled."""
        then, self._then = self._then, None
        self._surface()
        heading, north, east, _ = mm.on_leg(self._leg, mm.leg_length(self._leg))
        if then is not None and then.action is Action.GO_TO:
            self._lead(leg_to(heading, north, east, then.position_m, float(self._leg.radius)), along_m)
            return
        if then is not None and then.action is Action.SURFACE:
            self._params.depth = 0.0
        self._circle(along_m)

    def _circle(self, along_m: float) -> None:
        """Starts a circle at the leg's end."""
        heading, north, east, _ = mm.on_leg(self._leg, mm.leg_length(self._leg))
        radius = float(self._leg.radius)
        side = 1.0 if self._leg.turn > -NO_TURN_RAD else -1.0  # to starboard after a straight
        if self._clearance_m is not None:
            free = {
                s: self._clearance_m(north - s * radius * math.sin(heading), east + s * radius * math.cos(heading))
                for s in (1.0, -1.0)
            }
            side = max((1.0, -1.0), key=lambda s: (free[s], s == side))
        self._leg = new_record(LEG, heading, north, east, side * 2.0 * math.pi, radius, 0.0)
        self._loitering = True
        self._m.along = along_m

    def move(self, stamps_s: Array, currents: Array) -> tuple[Array, Array]:
        """Advances by sub-steps of one over the DVL's rate.

        Args:
            stamps_s: End of each sub-step (n,).
            currents: Current north, east of each sub-step (n, 2), m/s.

        Returns:
            True north and east (n,) of each sub-step, where `sense` needs the water depth.
        """
        m, n = self._m, len(stamps_s)
        normals = as_records(self._rng.standard_normal((n, len(NORMALS.names or ()))), NORMALS)
        uniforms = as_records(self._rng.random((n, len(UNIFORMS.names or ()))), UNIFORMS)
        draws = Draws(normals, uniforms, currents)
        rows = np.zeros(n, RESULT).view(np.recarray)
        dt = self._params.dt
        start_s = float(stamps_s[0]) - dt if n else 0.0
        i = 0
        if self._pilot is not None:
            advance_piloted(self._model, self._pilot.poses(stamps_s), draws, self._sounder.in_reach, rows)
            i = n
        while i < n:
            last, limit = n, math.inf
            if m.mode == mm.WAITING:
                until_start = math.ceil((self.config.start_delay_s - start_s) / dt - 1e-6)
                if self._next is not None and self._stop is None and i >= until_start:
                    order, self._next = self._next, None
                    self._begin(order, 0.0)
                    continue
                if self._next is not None and self._stop is None:
                    last = min(n, max(until_start, i + 1))
            else:
                limit = mm.leg_length(self._leg)
            i = mm.advance(self._model, self._leg, draws, self._sounder.in_reach, limit, rows, i, last)
            if m.mode != mm.WAITING and m.along >= limit - 1e-9:
                over = max(float(m.along) - limit, 0.0)
                if self._next is not None:
                    order, self._next = self._next, None
                    self._begin(order, over)
                elif self._loitering:
                    m.along = over
                else:
                    self._end(over)
        self._results = columns(rows)
        self._stamps = stamps_s
        self.fixes = self._completed()
        return self._results.north, self._results.east

    @property
    def gps_m(self) -> tuple[float, float] | None:
        """North, east by GPS if the antenna is above water; else None."""
        m = self._m
        if self.position[2] >= self._sim.gps.antenna_m:
            return None
        return float(m.north + m.gps_error_north), float(m.east + m.gps_error_east)

    def _completed(self) -> list[Fix]:
        """The fix completed in the last `move`, if any."""
        m = self._m
        if m.fix_step == 0.0:
            return []
        i, information = int(m.fix_step) - 1, float(m.fix_information)
        raw_north_m, raw_east_m = float(self._results.raw_north[i]), float(self._results.raw_east[i])
        fix = Fix(
            stamp_s=float(self._stamps[i]),
            north_m=raw_north_m + float(m.fix_north) / information,
            east_m=raw_east_m + float(m.fix_east) / information,
            raw_north_m=raw_north_m,
            raw_east_m=raw_east_m,
            std_m=information**-0.5,
        )
        m.fix_information = m.fix_north = m.fix_east = m.fix_step = 0.0
        return [fix]

    def sense(self, water_m: Array) -> Array:
        """Measures the water depth at the sub-steps of the last `move`.

        Args:
            water_m: True water depth (n,) there.

        Returns:
            Soundings (s, 6): stamp (s), estimated north, east (m), measured depth of water (m), raw north, east (m).
        """
        soundings = self._sounder.sound(self._stamps, self._results, water_m)
        kept_m = self._altitude.take(self._stamps, self._results, self._sounder.echoes_m, self._travel_m)
        if kept_m != self._kept_m:
            self._kept_m = kept_m
            if self._params.depth > 0.0:
                self._keep_depth()
        return soundings

    def keep_altitude(self, least_m: float) -> None:
        """Makes the vehicle climb where its echo sounder shows ground nearer than `least_m` (m); 0: never."""
        self._altitude = KeptAltitude(least_m)

    @property
    def altitude_m(self) -> float:
        """Altitude by the last ping; NaN without an echo."""
        return self._sounder.altitude_m

    @property
    def pressure_depth_m(self) -> float:
        """Depth by the pressure sensor at the last sub-step."""
        return self._sounder.pressure_depth_m

    @property
    def groundings(self) -> int:
        """Number of ticks in which the vehicle touched the ground."""
        return self._sounder.groundings

    def dead_reckoning(self, now_s: float) -> DeadReckoning:
        """Dead reckoning at the end of the last tick, with the measured depth."""
        raw = self._model.raw.x if self._m.raw_differs else self._x
        return DeadReckoning(
            stamp_s=now_s,
            heading_rad=float(raw[HEADING]),
            north_m=float(raw[NORTH]),
            east_m=float(raw[EAST]),
            depth_m=self.pressure_depth_m,
        )

    def odometry(self, now_s: float) -> NavigationEstimate:
        """The filter's estimate at the end of the last tick."""
        x = self._x
        return NavigationEstimate(
            stamp_s=now_s,
            heading_rad=float(x[HEADING]),
            north_m=float(x[NORTH]),
            east_m=float(x[EAST]),
            speed_mps=math.hypot(float(x[SURGE]), float(x[SWAY])) / (1.0 + float(x[DVL_SCALE])),
            covariance=self._p[_ODOMETRY],
            drift_rad=math.atan2(float(x[SWAY]), float(x[SURGE])) if self._pilot is not None else 0.0,
        )

    def truth(self, now_s: float) -> Truth:
        """The true state at the end of the last tick."""
        m = self._m
        return Truth(
            stamp_s=now_s,
            heading_rad=float(m.heading),
            north_m=float(m.north),
            east_m=float(m.east),
            depth_m=float(m.depth),
            speed_mps=math.hypot(float(m.surge), float(m.sway)),
            travelled_m=float(m.travelled),
            water_m=self._sounder.water_m,
            step=self._step if self._pilot is None else self._pilot.step,
            along_m=float(m.along),
            loitering=self._loitering and self._interrupted is None if self._pilot is None else self._pilot.has_arrived,
        )
