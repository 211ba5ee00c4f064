"""Bayes-risk level-set estimation on an online Gaussian process."""

from auv_lse_gp.area import AreaConfig, Grid, OperatingArea
from auv_lse_gp.conditioned import Conditioned
from auv_lse_gp.config import GpConfig
from auv_lse_gp.depth_map import DepthMap, Field, Isobath, contours
from auv_lse_gp.kernels import Kernel
from auv_lse_gp.online import Centers, Counts, IllConditionedError, OnlineGp, Outcome, SoundingError
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
    "Conditioned",
    "Counts",
    "DepthMap",
    "Field",
    "GpConfig",
    "Grid",
    "IllConditionedError",
    "Isobath",
    "Kernel",
    "LevelSet",
    "OnlineGp",
    "OperatingArea",
    "Outcome",
    "SoundingError",
    "bayes_estimate",
    "bayes_risk",
    "benefit_of_search",
    "contours",
    "expected_bayes_risk",
    "p_safe",
    "read_soundings",
]
