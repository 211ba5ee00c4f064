"""Bayes-risk level-set estimation on an online Gaussian process."""

from typing import TYPE_CHECKING

from auv_lse_common.support.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from auv_lse_common.mission_file.operating_area import Grid, OperatingArea
    from auv_lse_common.mission_file.sections.area import AreaConfig
    from auv_lse_common.mission_file.sections.gp import GpConfig
    from auv_lse_gp.covariance.kernels import Kernel
    from auv_lse_gp.inference.cached_points import CachedPoints
    from auv_lse_gp.inference.centers import Centers
    from auv_lse_gp.inference.factor import IllConditionedError
    from auv_lse_gp.inference.point_posteriors import PointPosteriors
    from auv_lse_gp.inference.posterior import Posterior
    from auv_lse_gp.level_set.bayes_risk import (
        LevelSet,
        bayes_estimate,
        bayes_risk,
        benefit_of_search,
        expected_bayes_risk,
        p_safe,
    )
    from auv_lse_gp.level_set.lines import contours
    from auv_lse_gp.map.depth_map import DepthField, DepthMap, Isobath
    from auv_lse_gp.map.gate import SoundingError
    from auv_lse_gp.map.online import Counts, OnlineGp
    from auv_lse_gp.map.store import Outcome
    from auv_lse_gp.soundings import read_soundings

__all__ = [
    "AreaConfig",
    "CachedPoints",
    "Centers",
    "Counts",
    "DepthField",
    "DepthMap",
    "GpConfig",
    "Grid",
    "IllConditionedError",
    "Isobath",
    "Kernel",
    "LevelSet",
    "OnlineGp",
    "OperatingArea",
    "Outcome",
    "PointPosteriors",
    "Posterior",
    "SoundingError",
    "bayes_estimate",
    "bayes_risk",
    "benefit_of_search",
    "contours",
    "expected_bayes_risk",
    "p_safe",
    "read_soundings",
]

__getattr__ = lazy_exports(
    __name__,
    {
        "auv_lse_common.mission_file.sections.area": ("AreaConfig",),
        "auv_lse_common.mission_file.operating_area": ("Grid", "OperatingArea"),
        "inference.centers": ("Centers",),
        "inference.point_posteriors": ("PointPosteriors",),
        "auv_lse_common.mission_file.sections.gp": ("GpConfig",),
        "map.depth_map": ("DepthField", "DepthMap", "Isobath"),
        "inference.factor": ("IllConditionedError",),
        "map.gate": ("SoundingError",),
        "inference.cached_points": ("CachedPoints",),
        "covariance.kernels": ("Kernel",),
        "map.online": ("Counts", "OnlineGp"),
        "map.store": ("Outcome",),
        "inference.posterior": ("Posterior",),
        "level_set.bayes_risk": (
            "LevelSet",
            "bayes_estimate",
            "bayes_risk",
            "benefit_of_search",
            "expected_bayes_risk",
            "p_safe",
        ),
        "level_set.lines": ("contours",),
        "soundings": ("read_soundings",),
    },
)
