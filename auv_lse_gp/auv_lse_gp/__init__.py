"""Bayes-risk level-set estimation on an online Gaussian process."""

from typing import TYPE_CHECKING

from auv_lse_common.face import face

if TYPE_CHECKING:
    from auv_lse_gp.area import AreaConfig, Grid, OperatingArea
    from auv_lse_gp.centers import Centers
    from auv_lse_gp.columns import Columns
    from auv_lse_gp.config import GpConfig
    from auv_lse_gp.depth_map import DepthField, DepthMap, Isobath, contours
    from auv_lse_gp.factor import IllConditionedError
    from auv_lse_gp.gate import SoundingError
    from auv_lse_gp.kept import KeptColumns
    from auv_lse_gp.kernels import Kernel
    from auv_lse_gp.online import Counts, OnlineGp, Outcome
    from auv_lse_gp.posterior import Posterior
    from auv_lse_gp.risk import (
        LevelSet,
        bayes_estimate,
        bayes_risk,
        benefit_of_search,
        expected_bayes_risk,
        p_safe,
    )
    from auv_lse_gp.soundings import read_soundings

__all__ = [
    "AreaConfig",
    "Centers",
    "Columns",
    "Counts",
    "DepthField",
    "DepthMap",
    "GpConfig",
    "Grid",
    "IllConditionedError",
    "Isobath",
    "KeptColumns",
    "Kernel",
    "LevelSet",
    "OnlineGp",
    "OperatingArea",
    "Outcome",
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

__getattr__ = face(
    __name__,
    {
        "area": ("AreaConfig", "Grid", "OperatingArea"),
        "centers": ("Centers",),
        "columns": ("Columns",),
        "config": ("GpConfig",),
        "depth_map": ("DepthField", "DepthMap", "Isobath", "contours"),
        "factor": ("IllConditionedError",),
        "gate": ("SoundingError",),
        "kept": ("KeptColumns",),
        "kernels": ("Kernel",),
        "online": ("Counts", "OnlineGp", "Outcome"),
        "posterior": ("Posterior",),
        "risk": ("LevelSet", "bayes_estimate", "bayes_risk", "benefit_of_search", "expected_bayes_risk", "p_safe"),
        "soundings": ("read_soundings",),
    },
)
