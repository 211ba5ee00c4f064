"""Corrects the positions of soundings afterwards, from fixes, ranges between vehicles, and crossings of tracks."""

from typing import TYPE_CHECKING

from auv_lse_common.support.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from auv_lse_common.mission_file.sections.positions import PositionsConfig
    from auv_lse_gp.positions.correction import Correction
    from auv_lse_gp.positions.smoother import PositionSmoother
    from auv_lse_gp.positions.terrain_matching import Terrain
    from auv_lse_gp.positions.track import MateTrack, OwnTrack, Track
    from auv_lse_gp.positions.track_segments import TrackSegments

__all__ = [
    "Correction",
    "MateTrack",
    "OwnTrack",
    "PositionSmoother",
    "PositionsConfig",
    "Terrain",
    "Track",
    "TrackSegments",
]

__getattr__ = lazy_exports(
    __name__,
    {
        "auv_lse_common.mission_file.sections.positions": ("PositionsConfig",),
        "correction": ("Correction",),
        "track_segments": ("TrackSegments",),
        "smoother": ("PositionSmoother",),
        "terrain_matching": ("Terrain",),
        "track": ("MateTrack", "OwnTrack", "Track"),
    },
)
