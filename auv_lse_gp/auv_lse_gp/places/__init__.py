"""Corrects the positions of soundings afterwards, from fixes, ranges between vehicles, and crossings of tracks."""

from typing import TYPE_CHECKING

from auv_lse_common.support.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from auv_lse_common.mission_file.sections.places import PlacesConfig
    from auv_lse_gp.places.correction import Correction
    from auv_lse_gp.places.smoother import PositionSmoother
    from auv_lse_gp.places.terrain_matching import Terrain
    from auv_lse_gp.places.track import MateTrack, OwnTrack, Track
    from auv_lse_gp.places.track_segments import TrackSegments

__all__ = [
    "Correction",
    "MateTrack",
    "OwnTrack",
    "PlacesConfig",
    "PositionSmoother",
    "Terrain",
    "Track",
    "TrackSegments",
]

__getattr__ = lazy_exports(
    __name__,
    {
        "auv_lse_common.mission_file.sections.places": ("PlacesConfig",),
        "correction": ("Correction",),
        "track_segments": ("TrackSegments",),
        "smoother": ("PositionSmoother",),
        "terrain_matching": ("Terrain",),
        "track": ("MateTrack", "OwnTrack", "Track"),
    },
)
