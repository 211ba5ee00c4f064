"""Corrections that a recording lacks: water level, vertical datum and sound speed, with their uncertainties.

Depths of a recording are below the water surface of the moment, as the sounder converted its travel times. `reduce`
turns them into depths below a datum:

1. The sound speed of the water replaces that of the sounder: the same travel time along a vertical path.
2. The height of the water surface above the datum is subtracted.
"""

import dataclasses
import datetime
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from auv_lse_common.mission_file.parameter_file import parameters_for
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.support.plurals import counted
from auv_lse_record.run_data import RunData, VehicleRun

#: Sound speed (m/s) that sounders assume unless they are set up otherwise.
USUAL_SOUNDER_SPEED_MPS = 1500.0
#: Times (s) from here on are UTC since 1970, as on vehicles; smaller ones count from the start of a simulation.
FIRST_UTC_S = 1e9
#: Between water levels farther apart than this multiple of their usual step, and than this time (s), the level is
#: unknown. Hourly levels are usual; between them a tide of 2 m amplitude is off by at most .06 m.
_LONGEST_GAP, _LONGEST_GAP_S = 5.0, 5400.0
#: Spacing (m) of the depths at which travel times through a profile are integrated.
_LAYER_M = 0.05


class SurveyError(ValueError):
    """A correction that cannot be used, or does not cover the recording."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Uncertainties:
    """Standard deviations of the inputs of a sounding, besides its position.

    Attributes:
        sounder_m: Noise of the sounder (m); None: `gp.noise_std_m` of the mission file.
        pressure_m: The vehicle's depth (m).
    """

    sounder_m: float | None = None
    pressure_m: float = 0.05
    sound_speed_mps: float = 5.0
    water_level_m: float = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """Corrections of a survey, and what its products are to contain.

    Attributes:
        water_level: Height of the water surface above the datum: rows (time s, m). One row: constant. None: the
            recording's depths refer to the datum already.
        datum: Name of the vertical datum; "" if none was given.
        sound_speed: Sound speed: rows (depth m, m/s). One row: constant. None: the sounder's speed was right.
        sounder_speed_mps: Sound speed with which the sounder converted travel times.
        std: Standard deviations.
        origin: WGS84 latitude and longitude (deg) of north = east = 0 for runs that have none; None if unknown.
        crs: Coordinate reference system of chart.tif and chart.bag, such as "EPSG:2056"; "": the UTM zone.
        contour_levels_m: Depths of contours.
        contour_interval_m: Interval of further contours; 0: none.
        provider: Name and e-mail address of the organization that submits crowdsourced bathymetry; None if unknown.
        sources: Where the corrections come from, by their name: a file or "constant".
    """

    water_level: Array | None = None
    datum: str = ""
    sound_speed: Array | None = None
    sounder_speed_mps: float = USUAL_SOUNDER_SPEED_MPS
    std: Uncertainties = field(default_factory=Uncertainties)
    origin: tuple[float, float] | None = None
    crs: str = ""
    contour_levels_m: tuple[float, ...] = ()
    contour_interval_m: float = 0.0
    provider: tuple[str, str] | None = None
    sources: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Checks that reduced depths have a named datum.

        Raises:
            SurveyError: if a water level has no datum.
        """
        if self.water_level is not None and not self.datum:
            raise SurveyError('--water-level needs --datum, the datum\'s name, such as LAT or "LN02 372 m"')

    @property
    def vertical_datum(self) -> str:
        """Name of the vertical datum of depths."""
        return self.datum or "water surface during the dive"

    def describe(self) -> dict[str, str]:
        """Datum, corrections and uncertainties in words, as every product records them."""
        std = self.std
        sounder = "gp.noise_std_m" if std.sounder_m is None else f"{std.sounder_m:g} m"
        return {
            "vertical_datum": self.vertical_datum,
            "water_level": _described(self.water_level, self.sources.get("water level", ""), "m above the datum"),
            "sound_speed": _described(self.sound_speed, self.sources.get("sound speed", ""), "m/s"),
            "sounder_sound_speed": f"{self.sounder_speed_mps:g} m/s",
            "standard_deviations": (
                f"sounder {sounder}, pressure {std.pressure_m:g} m, sound speed {std.sound_speed_mps:g} m/s, "
                f"water level {std.water_level_m:g} m"
            ),
        }

    def reduce(self, run: RunData) -> RunData:
        """A run with its own soundings corrected; samples that vehicles heard under way are unchanged.

        Raises:
            SurveyError: if the water level does not cover the soundings, or the run has another origin.
        """
        if self.origin is not None and run.origin not in (None, self.origin):
            raise SurveyError(f"--origin: the mission has one, {run.origin[0]:g}, {run.origin[1]:g} deg; leave it out")
        run = dataclasses.replace(run, origin=self.origin or run.origin)
        if self.water_level is None and self.sound_speed is None:
            return run
        vehicles = [self._reduced(v, vehicle_depth_m(run, v)) for v in run.vehicles]
        stamps_s = np.concatenate([vehicle.soundings.stamp_s for vehicle in run.vehicles])
        notes = [*self._notes_above(vehicles), *self._notes_between(stamps_s)]
        return dataclasses.replace(run, vehicles=vehicles, notes=[*run.notes, *notes])

    def _notes_above(self, vehicles: Sequence[VehicleRun]) -> list[str]:
        """A note on soundings above the datum, which no map takes."""
        depth = np.concatenate([vehicle.soundings.depth_m for vehicle in vehicles])
        above, count = int((depth <= 0.0).sum()), counted(len(depth), "sounding")
        if self.water_level is None or not above:
            return []
        if above < len(depth):
            return [f"{above} of {count} lie above {self.datum} and are not mapped"]
        levels = _described(self.water_level, self.sources.get("water level", ""), "m")
        near_m = round(float(np.median(self.water_level[:, 1])))
        rest_m = round(float(self.water_level[0, 1]) - near_m, 3)
        table = f"and a table of levels {near_m} m lower"
        datum = self.datum.removesuffix(f" {near_m} m")
        raise SurveyError(
            f"--water-level of {levels} puts all {count} above {self.datum}, by {-depth.max():.1f} to "
            f"{-depth.min():.1f} m. Give the height of the water surface above a datum near it, in metres, such as "
            f'--datum "{datum} {near_m} m" {table if len(self.water_level) > 1 else f"--water-level {rest_m:g}"}'
        )

    def _notes_between(self, stamps_s: Array) -> list[str]:
        """A note on levels so far apart around soundings that a tide could pass between them unseen."""
        if self.water_level is None or len(self.water_level) < 2 or not len(stamps_s):
            return []
        apart_s = float(_step_around(self.water_level[:, 0], stamps_s)[1].max())
        if apart_s <= _LONGEST_GAP_S:
            return []
        return [f"water levels are interpolated over {apart_s / 3600.0:.3g} h; a tide between them would be missed"]

    def _reduced(self, vehicle: VehicleRun, vehicle_depth: Array) -> VehicleRun:
        soundings, depth = vehicle.soundings, vehicle.soundings.depth_m
        if self.sound_speed is not None:
            depth = true_depth_m(depth, vehicle_depth, self.sound_speed, self.sounder_speed_mps)
        if self.water_level is not None:
            depth = depth - self.water_level_at(soundings.stamp_s)
        return dataclasses.replace(vehicle, soundings=dataclasses.replace(soundings, depth_m=depth))

    def water_level_at(self, stamp_s: Array) -> Array:
        """Water level (m) at times (n,).

        Raises:
            SurveyError: if a table of water levels does not cover them, or has a gap around some.
        """
        level = self.water_level
        if level is None:
            return np.zeros(len(stamp_s))
        if len(level) > 1 and len(stamp_s) and not level[0, 0] <= stamp_s.min() <= stamp_s.max() <= level[-1, 0]:
            raise SurveyError(
                f"--water-level covers only {moment(level[0, 0])} to {moment(level[-1, 0])}, but the soundings are "
                f"from {moment(stamp_s.min())} to {moment(stamp_s.max())}. Give the levels of the whole dive"
            )
        _check_gaps(level[:, 0], stamp_s)
        return np.interp(stamp_s, level[:, 0], level[:, 1])


def _check_gaps(times_s: Array, stamp_s: Array) -> None:
    """Checks that no sounding lies in a gap between the times (n,) of water levels."""
    steps = np.diff(times_s)
    if len(steps) < 2 or not len(stamp_s):
        return
    usual_s = float(np.median(steps))
    before, around = _step_around(times_s, stamp_s)
    if around.max() > max(_LONGEST_GAP * usual_s, _LONGEST_GAP_S):
        first = before[around.argmax()]
        raise SurveyError(
            f"--water-level has no level from {moment(times_s[first])} to {moment(times_s[first + 1])}, "
            f"where levels are usually {usual_s:g} s apart, and {counted(int((before == first).sum()), 'sounding')} "
            "are within. Add the levels of this time, measured or predicted"
        )


def _step_around(times_s: Array, stamp_s: Array) -> tuple[Ints, Array]:
    """The level before each sounding (n,), and the time from it to the next (s); 0 for one at the time of a level."""
    before = (np.searchsorted(times_s, stamp_s) - 1).clip(0)
    return before, np.where(times_s[before + 1] == stamp_s, 0.0, np.diff(times_s)[before])


def moment(stamp_s: float) -> str:
    """A time for messages: UTC, or seconds of a simulation."""
    if stamp_s < FIRST_UTC_S:
        return f"{stamp_s:.0f} s"
    return f"{datetime.datetime.fromtimestamp(stamp_s, datetime.UTC):%Y-%m-%dT%H:%M:%SZ}"


def _described(table: Array | None, source: str, unit: str) -> str:
    if table is None:
        return "not corrected"
    low, high = table[:, 1].min(), table[:, 1].max()
    values = f"{low:g}" if low == high else f"{low:g} to {high:g}"
    return f"{values} {unit}{f' ({source})' if source else ''}"


def vehicle_depth_m(run: RunData, vehicle: VehicleRun) -> Array:
    """Depth (n,) of a vehicle (m) at its soundings: from its track, or its section `vehicle` if it has none."""
    track = vehicle.dead_reckoning
    if len(track) > 1:
        return np.interp(vehicle.soundings.stamp_s, track[:, 0], track[:, 4])
    nested = parameters_for(run.parameters, f"/auv{vehicle.vehicle}/planner_node")
    settings = PlannerSettings.from_parameters(nested, "mission file", vehicle.vehicle)
    return np.full(len(vehicle.soundings), settings.vehicle.depth_m)


def true_depth_m(depth_m: Array, vehicle_depth: Array, sound_speed: Array, sounder_speed_mps: float) -> Array:
    """Depths (n,) from the travel times of a sounder, along vertical paths through a sound speed profile.

    The sounder measured half of the two-way travel time, (depth - vehicle depth) / sounder speed. The true depth is
    where the integral of 1 / c(z) from the vehicle's depth equals it. Above and below the profile, c is constant.

    Args:
        depth_m: Depths as the sounder computed them, shape (n,).
        vehicle_depth: Depths of the sounder, shape (n,).
        sound_speed: Rows (depth m, m/s), by increasing depth.
        sounder_speed_mps: Sound speed that the sounder used.
    """
    if not len(depth_m):
        return depth_m
    reach = 1.3 * float(max(depth_m.max(), vehicle_depth.max(), 1.0))
    z = np.arange(0.0, reach + _LAYER_M, _LAYER_M)
    slowness = 1.0 / np.interp(z, sound_speed[:, 0], sound_speed[:, 1])
    travel = np.concatenate([[0.0], np.cumsum(0.5 * (slowness[1:] + slowness[:-1]) * _LAYER_M)])
    start = np.interp(vehicle_depth, z, travel)
    corrected = np.interp(start + (depth_m - vehicle_depth) / sounder_speed_mps, travel, z)
    return np.where(depth_m > vehicle_depth, corrected, depth_m)
