"""What an export contains, and the coordinates of its files."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from auv_lse_common.support.arrays import Array
from auv_lse_common.support.plurals import counted
from auv_lse_shore.export.survey import FIRST_UTC_S, Survey, moment
from auv_lse_shore.judge.team_map import TeamMap

#: Value of raster cells outside of the operating area.
NODATA = -9999.0


class ExportError(ValueError):
    """An export that cannot be made, for instance because a library is missing."""


class Raster(NamedTuple):
    """A map to export: values (ny, nx), southernmost row first, NaN outside of the operating area."""

    name: str
    meaning: str
    unit: str
    values: Array

    @property
    def northern_row_first(self) -> Array:
        """The values as raster files have them: northernmost row first, `NODATA` outside of the area."""
        return np.where(np.isnan(self.values), NODATA, self.values)[::-1]


#: Why a file with positions on Earth is not written.
NO_ORIGIN = "skipped, because the mission has no origin; give --origin LAT LON"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """Coordinates of an export: x = east and y = north of the mission's origin, in meters.

    Attributes:
        origin: WGS84 latitude and longitude (deg) of x = y = 0; None if the mission has none.
    """

    origin: tuple[float, float] | None

    @property
    def proj(self) -> str:
        """The mission's local frame (docs/reference/frames.md) as a PROJ string; "" without origin."""
        if self.origin is None:
            return ""
        latitude, longitude = self.origin
        return f"+proj=aeqd +lat_0={latitude!r} +lon_0={longitude!r} +datum=WGS84 +units=m +no_defs"

    def wkt(self, version: str = "WKT1_GDAL") -> str:
        """The same as well-known text ("WKT1_ESRI" for .prj files); "" without origin.

        Version 1, because PROJ before 9.3 does not know version 2's name of this projection.
        """
        if self.origin is None:
            return ""
        from pyproj import CRS

        name = f"metres about {self.origin[0]:.6f}, {self.origin[1]:.6f} deg"
        return str(CRS.from_proj4(self.proj).to_wkt(version)).replace('"unknown"', f'"{name}"', 1)

    def describe(self) -> str:
        """The coordinates in one sentence, for users."""
        if self.origin is None:
            return "local metres, east and north of the mission's origin; --origin LAT LON georeferences the files"
        latitude, longitude = self.origin
        return f"metres about {latitude:.6f}, {longitude:.6f} deg (azimuthal equidistant, WGS84)"


def _period(stamps_s: Array) -> str:
    """When soundings (n,) were taken; a chart of a simulation must not pass for one of a lake."""
    if not len(stamps_s):
        return ""
    if stamps_s.min() < FIRST_UTC_S:
        return ", simulated or without dates"
    return f" from {moment(stamps_s.min())} to {moment(stamps_s.max())}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Export:
    """Everything that a format may write.

    Attributes:
        team: The mission's map and isobath; its `run` has the soundings.
        folder: Where the files go; it exists. They are moved to the user's folder when all are complete.
        survey: Corrections that the depths of `team` have, and what products are asked for.
        discarded: Patterns of `discard`.
    """

    team: TeamMap
    folder: Path
    survey: Survey = field(default_factory=Survey)
    discarded: set[str] = field(default_factory=set)

    def discard(self, pattern: str) -> None:
        """Removes files of an earlier export: from `folder` now, from the user's folder once all are complete."""
        self.discarded.add(pattern)
        for path in self.folder.glob(pattern):
            path.unlink()

    @property
    def reference(self) -> Reference:
        """The coordinates of all files."""
        return Reference(origin=self.team.run.origin)

    def metadata(self) -> dict[str, str]:
        """Coordinates, soundings, datum, corrections and uncertainties in words, for the files' metadata."""
        stamps_s = np.concatenate([vehicle.soundings.stamp_s for vehicle in self.team.run.vehicles])
        return {
            "coordinates": self.reference.describe(),
            "soundings": f"{counted(len(stamps_s), 'sounding')}{_period(stamps_s)}",
            **self.survey.describe(),
        }

    def rasters(self) -> Iterator[Raster]:
        """The maps."""
        cells = self.team.field
        yield Raster("risk", "Bayes risk of the better classification", "cost per location", cells.risk)
        yield Raster("depth", "depth of water, positive down", "m", cells.mean_m)
        yield Raster("std", "standard deviation of the depth", "m", cells.std_m)

    def corner(self) -> tuple[float, float]:
        """East and north (m) of the south-western corner of the maps, half a cell outside of its center."""
        grid = self.team.field.grid
        half = 0.5 * grid.resolution_m
        return float(grid.east_m[0]) - half, float(grid.north_m[0]) - half
