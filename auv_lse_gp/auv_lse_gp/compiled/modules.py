"""Loads the modules of compiled code on first use, since numba takes a second to load."""

from functools import cache
from typing import Any


@cache
def compiled_gp() -> Any:
    """Compiled covariances and solves."""
    from auv_lse_gp.compiled import covariances as module

    return module


@cache
def compiled_risk() -> Any:
    """Compiled expected Bayes risk."""
    from auv_lse_gp.compiled import risk as module

    return module
