"""Which of the compiled (numba) kernels are used; without numba the NumPy ones run, with the same results.

Set the environment variable AUV_LSE_NUMBA=0 before the import to force the NumPy ones.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
from typing import Any

#: Whether the compiled kernels are used. Tests switch it to compare both.
AVAILABLE = os.environ.get("AUV_LSE_NUMBA", "1") != "0" and importlib.util.find_spec("numba") is not None


def risk() -> Any:
    """The module of compiled risk functions (imported, and loaded from numba's cache, at the first call)."""
    return importlib.import_module("auv_lse_gp.compiled_risk")


def gp() -> Any:
    """The module of compiled GP functions (imported, and loaded from numba's cache, at the first call)."""
    return importlib.import_module("auv_lse_gp.compiled_gp")
