"""The coordinates of an export: metres about the mission's origin, on Earth where that is known."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """Where x = east and y = north of an export are.

    Attributes:
        origin: WGS84 latitude and longitude (deg) of x = y = 0, None if the mission names none.
    """

    origin: tuple[float, float] | None

    @property
    def proj(self) -> str:
        """The mission's local frame as a PROJ string (docs/reference/frames.md); "" without origin."""
        if self.origin is None:
            return ""
        latitude, longitude = self.origin
        return f"+proj=aeqd +lat_0={latitude!r} +lon_0={longitude!r} +datum=WGS84 +units=m +no_defs"

    def wkt(self, version: str = "WKT1_GDAL") -> str:
        """The same as well-known text ("WKT1_ESRI" for .prj files); "" without origin.

        The first version, because PROJ before 9.3 does not know the second's name of this projection.
        """
        if self.origin is None:
            return ""
        from pyproj import CRS

        name = f"metres about {self.origin[0]:.6f}, {self.origin[1]:.6f} deg"
        return str(CRS.from_proj4(self.proj).to_wkt(version)).replace('"unknown"', f'"{name}"', 1)

    def describe(self) -> str:
        """One sentence for a person."""
        if self.origin is None:
            return (
                "local metres, east and north of the mission's origin: its area has no origin_lat_deg, origin_lon_deg, "
                "so the files name no place on Earth"
            )
        latitude, longitude = self.origin
        return f"metres about {latitude:.6f}, {longitude:.6f} deg (azimuthal equidistant, WGS84)"
