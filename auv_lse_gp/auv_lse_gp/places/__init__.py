"""Where soundings were taken: found out afterwards from fixes, ranges between vehicles, and crossings of tracks."""

from typing import TYPE_CHECKING

from auv_lse_common.support.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from auv_lse_common.mission_file.sections.places import PlacesConfig
    from auv_lse_gp.places.correction import Correction
    from auv_lse_gp.places.pieces import Pieces
    from auv_lse_gp.places.smoother import PlaceSmoother
    from auv_lse_gp.places.terrain import Terrain
    from auv_lse_gp.places.track import HeardTrack, OwnTrack, Track

__all__ = ["Correction", "HeardTrack", "OwnTrack", "Pieces", "PlaceSmoother", "PlacesConfig", "Terrain", "Track"]

__getattr__ = lazy_exports(
    __name__,
    {
        "auv_lse_common.mission_file.sections.places": ("PlacesConfig",),
        "correction": ("Correction",),
        "pieces": ("Pieces",),
        "smoother": ("PlaceSmoother",),
        "terrain": ("Terrain",),
        "track": ("HeardTrack", "OwnTrack", "Track"),
    },
)
