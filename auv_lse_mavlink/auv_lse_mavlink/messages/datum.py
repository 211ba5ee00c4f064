"""The mission's origin and the autopilot's: conversion of positions between their local planes, and to WGS84."""

from __future__ import annotations

from dataclasses import dataclass

from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.vocabulary.frames import geodetic_from_local, local_from_geodetic


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """A point on the WGS84 ellipsoid from which a local plane is measured."""

    lat_deg: float
    lon_deg: float

    @classmethod
    def of(cls, area: AreaConfig) -> Origin | None:
        """The mission's origin; None if it has none."""
        return None if area.origin_deg is None else cls(lat_deg=area.origin_deg[0], lon_deg=area.origin_deg[1])


def _shift(mission: Origin | None, autopilot: Origin | None) -> tuple[float, float]:
    """North and east (m) of the autopilot's origin in the mission's plane; 0, 0 unless both are known."""
    if mission is None or autopilot is None:
        return 0.0, 0.0
    north, east = local_from_geodetic(autopilot.lat_deg, autopilot.lon_deg, mission.lat_deg, mission.lon_deg)
    return float(north), float(east)


@dataclass(frozen=True, slots=True)
class Datum:
    """The mission's origin and the autopilot's, either None if unknown."""

    mission: Origin | None
    autopilot: Origin | None = None

    def from_local_ned(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Mission north and east (m) of LOCAL_POSITION_NED's x, y."""
        north, east = _shift(self.mission, self.autopilot)
        return x_m + north, y_m + east

    def to_local_ned(self, north_m: float, east_m: float) -> tuple[float, float]:
        """x, y (m) in the autopilot's local frame of mission north and east."""
        north, east = _shift(self.mission, self.autopilot)
        return north_m - north, east_m - east

    def from_geodetic(self, lat_e7: int, lon_e7: int) -> tuple[float, float]:
        """Mission north and east (m) of a latitude and longitude in 1e-7 degrees.

        Raises:
            ValueError: if the mission has no origin.
        """
        origin = self._origin()
        north, east = local_from_geodetic(lat_e7 * 1e-7, lon_e7 * 1e-7, origin.lat_deg, origin.lon_deg)
        return float(north), float(east)

    def to_geodetic(self, north_m: float, east_m: float) -> tuple[int, int]:
        """Latitude and longitude in 1e-7 degrees (1 cm) of mission north and east (m).

        Raises:
            ValueError: if the mission has no origin.
        """
        origin = self._origin()
        lat, lon = geodetic_from_local(north_m, east_m, origin.lat_deg, origin.lon_deg)
        return round(float(lat) * 1e7), round(float(lon) * 1e7)

    def _origin(self) -> Origin:
        if self.mission is None:
            raise ValueError("the mission has no origin; set area.origin_lat_deg and area.origin_lon_deg")
        return self.mission
