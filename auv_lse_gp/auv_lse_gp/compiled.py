"""Which of the compiled (numba) kernels are used; without numba the NumPy ones run, with the same results.

Set the environment variable AUV_LSE_NUMBA=0 before the import to force the NumPy ones.
"""

from __future__ import annotations

import functools
import importlib
import importlib.util
import os
import tempfile
from pathlib import Path
from typing import Any

#: Whether the compiled kernels are used. Tests switch it to compare both.
AVAILABLE = os.environ.get("AUV_LSE_NUMBA", "1") != "0" and importlib.util.find_spec("numba") is not None


def _cache_somewhere() -> None:
    """Where neither the package nor the home can be written to, numba would refuse to compile: then keep it aside."""
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    package, home = Path(__file__).parent, Path(os.environ.get("XDG_CACHE_HOME", os.path.expanduser("~")))
    if not any(os.access(folder, os.W_OK) for folder in (package, home)):
        os.environ["NUMBA_CACHE_DIR"] = str(Path(tempfile.gettempdir()) / f"auv_lse_numba_{os.getuid()}")


if AVAILABLE:
    _cache_somewhere()


@functools.cache
def risk() -> Any:
    """The module of compiled risk functions (imported, and loaded from numba's cache, at the first call)."""
    return importlib.import_module("auv_lse_gp.compiled_risk")


@functools.cache
def gp() -> Any:
    """The module of compiled GP functions (imported, and loaded from numba's cache, at the first call)."""
    return importlib.import_module("auv_lse_gp.compiled_gp")
