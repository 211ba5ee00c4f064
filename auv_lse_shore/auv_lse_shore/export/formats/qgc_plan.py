"""isobath.plan: a QGroundControl plan: the longest piece found as waypoints, the area as geofence; needs an origin."""

import json
from typing import Any

import numpy as np
import shapely

from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_gp.map.certainty import FOUND
from auv_lse_shore.export.content import NO_ORIGIN, Export
from auv_lse_shore.judge.team_map import TeamMap, mission_settings

#: Largest distance (m) of the path along the waypoints from the isobath.
TOLERANCE_M = 1.0

# Numbers of MAVLink: a surface boat with ArduPilot; go to a waypoint; altitudes relative to home.
_ARDUPILOT, _SURFACE_BOAT, _WAYPOINT, _RELATIVE = 3, 11, 16, 3
#: Speed (m/s) from which QGroundControl estimates the duration.
_SPEED_MPS = 1.5


def write(export: Export) -> str:
    """Writes waypoints, the area and the no-go areas as geofence, and the recovery positions as rally points."""
    path, origin, team = export.folder / "isobath.plan", export.reference.origin, export.team
    if origin is None:
        export.discard(path.name)
        return f"isobath.plan: {NO_ORIGIN}"

    def geodetic(locations_m: Array) -> list[list[float]]:
        latitude, longitude = geodetic_from_local(locations_m[:, 0], locations_m[:, 1], *origin)
        return [[float(lat), float(lon)] for lat, lon in zip(latitude.round(7), longitude.round(7), strict=True)]

    waypoints = geodetic(_waypoints(team))
    fences = [{"inclusion": True, "polygon": geodetic(team.area.polygon), "version": 1}]
    fences += [{"inclusion": False, "polygon": geodetic(ring), "version": 1} for ring in team.area.no_go.values()]
    rally = [[*location, 0.0] for location in geodetic(_recoveries(team))]
    plan = {
        "fileType": "Plan",
        "groundStation": "QGroundControl",
        "version": 1,
        "mission": {
            "version": 2,
            "firmwareType": _ARDUPILOT,
            "vehicleType": _SURFACE_BOAT,
            "globalPlanAltitudeMode": 1,
            "cruiseSpeed": _SPEED_MPS,
            "hoverSpeed": _SPEED_MPS,
            "plannedHomePosition": [*(rally or waypoints or geodetic(team.area.polygon))[0][:2], 0.0],
            "items": [_item(number, *location) for number, location in enumerate(waypoints, 1)],
        },
        "geoFence": {"version": 2, "circles": [], "polygons": fences},
        "rallyPoints": {"version": 2, "points": rally},
    }
    path.write_text(json.dumps(plan, indent=1))
    if not len(waypoints):
        return "isobath.plan (the area alone: no piece is found)"
    return f"isobath.plan ({len(waypoints)} waypoints along the longest piece found)"


def _waypoints(team: TeamMap) -> Array:
    """Corners (n, 2) north, east (m) of the longest piece found; none if nothing was found."""
    longest = max((p for p in team.pieces if p.kind == FOUND), key=lambda p: p.length_m, default=None)
    if longest is None:
        return np.empty((0, 2))
    return np.asarray(shapely.LineString(longest.line).simplify(TOLERANCE_M).coords)


def _recoveries(team: TeamMap) -> Array:
    """The different recovery positions (n, 2): north, east (m)."""
    vehicles = max((v.vehicle for v in team.run.vehicles), default=0)
    own = [settings.vehicle for settings in mission_settings(team.run.parameters, vehicles)]
    known = {(v.recovery_north_m, v.recovery_east_m): None for v in own if v.recovery_north_m is not None}
    return np.array(list(known), dtype=float).reshape(-1, 2)


def _item(number: int, latitude: float, longitude: float) -> dict[str, Any]:
    """A waypoint at the surface."""
    return {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": _WAYPOINT,
        "doJumpId": number,
        "frame": _RELATIVE,
        "params": [0, 0, 0, None, latitude, longitude, 0],
        "AMSLAltAboveTerrain": None,
        "Altitude": 0,
        "AltitudeMode": 1,
    }
