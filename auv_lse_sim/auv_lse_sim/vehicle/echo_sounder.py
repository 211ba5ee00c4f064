"""The depth instruments: DVL and altimeter beams, and the pressure sensor."""

import math

import numpy as np

from auv_lse_common.mission_file.sections.sim import SimConfig
from auv_lse_common.support.arrays import Array, Mask
from auv_lse_common.vocabulary.pings import by_period, period_of, sounding_of
from auv_lse_sim.vehicle.records import Results


class EchoSounder:
    """Measures the altitude under a vehicle and makes soundings of the pings.

    Attributes:
        in_reach: Whether the bottom was within the DVL's range at the last sub-step.
        water_m: True depth of the water there; NaN where it is unknown or land.
        altitude_m: Measured height over the ground there; NaN without an echo.
        echoes_m: Those of all sub-steps (n,).
        pressure_depth_m: Measured depth of the vehicle there.
        groundings: Number of ticks in which it touched the ground.
    """

    def __init__(self, sim: SimConfig, rng: np.random.Generator, bias: float) -> None:
        """Starts without an echo.

        Args:
            bias: Error of the pressure sensor, in standard deviations.
        """
        self._sim, self._rng = sim, rng
        self._bias_m = 0.0 if sim.pressure.ideal or sim.ideal else sim.pressure.bias_m * bias
        self._pings = np.empty((0, 6))  # the current period: stamp, estimated north, east, depth, raw north, east
        self.in_reach = True
        self.water_m = self.altitude_m = math.nan
        self.echoes_m = np.empty(0)
        self.pressure_depth_m = 0.0
        self.groundings = 0

    def sound(self, stamps_s: Array, results: Results, water_m: Array) -> Array:
        """Measures along one tick.

        Args:
            stamps_s: End of each sub-step (n,).
            results: Of the motion model.
            water_m: True depth of water (n,) there.

        Returns:
            Soundings (s, 6): stamp (s), estimated north, east (m), measured depth of water (m), raw north, east (m).
        """
        n, depth = len(stamps_s), results.depth
        normals, uniforms = self._rng.standard_normal((n, 2)), self._rng.random((n, 3))
        if n == 0:
            self.echoes_m = np.empty(0)
            return np.empty((0, 6))
        altitude = water_m - depth
        self.water_m = float(water_m[-1])
        aground = ~(altitude > 0.0)
        self.groundings += int(aground.any() and not np.isnan(water_m).all())
        in_reach = self._reached(altitude)
        echo = np.where(results.ping > 0.0, altitude, np.nan)
        echo = np.where(in_reach, self._altimeter(echo, normals[:, 0], uniforms), np.nan)
        own = self._pressure(depth, normals[:, 1])
        self.in_reach = bool(in_reach[-1])
        self.altitude_m, self.echoes_m = float(echo[-1]), echo
        self.pressure_depth_m = float(own[-1])
        pings = np.empty((n, 6))
        pings[:, 0], pings[:, 1], pings[:, 2] = stamps_s, results.est_north, results.est_east
        pings[:, 3] = own + echo
        pings[:, 4], pings[:, 5] = results.raw_north, results.raw_east
        return self._soundings(pings[np.isfinite(echo)], float(stamps_s[-1]))

    def _reached(self, altitude_m: Array) -> Mask:
        """Whether the bottom is within the DVL's range."""
        sim = self._sim
        if sim.dvl.ideal or sim.ideal:
            return np.asarray(altitude_m > 0.0)
        with np.errstate(invalid="ignore"):
            return np.asarray((altitude_m >= sim.dvl.min_altitude_m) & (altitude_m <= sim.dvl.max_altitude_m))

    def _altimeter(self, echo_m: Array, normals: Array, uniforms: Array) -> Array:
        """Measured altitudes (n,) from true ones, normal (n,) and uniform (n, 3) random numbers."""
        altimeter = self._sim.altimeter
        if altimeter.ideal or self._sim.ideal:
            return echo_m
        echo_m = echo_m + altimeter.noise_m * normals
        wrong = uniforms[:, 0] < altimeter.outlier_share
        if wrong.any():
            size = -altimeter.outlier_m * np.log1p(-uniforms[:, 1]) * np.where(uniforms[:, 2] < 0.5, -1.0, 1.0)
            echo_m = np.where(wrong, np.maximum(echo_m + size, 0.1), echo_m)
        return echo_m

    def _pressure(self, depth_m: Array, normals: Array) -> Array:
        """Measured depths (n,) from true ones and normal random numbers (n,)."""
        pressure = self._sim.pressure
        if pressure.ideal or self._sim.ideal:
            return depth_m
        return np.asarray(depth_m + self._bias_m + pressure.noise_m * normals)

    def _soundings(self, pings: Array, now_s: float) -> Array:
        """The soundings of completed periods; keeps the pings of the current one."""
        period_s = self._sim.altimeter.sounding_every_s
        if period_s == 0.0:
            return pings
        waiting = np.concatenate([self._pings, pings])
        over = math.floor(now_s / period_s + 1e-6)
        count = int(np.searchsorted(period_of(waiting[:, 0], period_s), over, side="right"))
        self._pings = waiting[count:]
        periods = by_period(waiting[:count], period_s)
        if self._sim.altimeter.ideal or self._sim.ideal:
            soundings = [own[len(own) // 2] for own in periods]
        else:
            soundings = [sounding_of(own) for own in periods if len(own) >= self._sim.altimeter.least_pings]
        return np.array(soundings).reshape(-1, 6)
