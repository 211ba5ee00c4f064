"""Optional compilation: the inner loops run through numba where it is installed, and as plain Python where not.

The plain functions are the reference; tests call both (`function.py_func`) and compare them. The environment variable
AUV_LSE_NUMBA=0, set before the import, forces the plain ones.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

try:
    import numba

    HAVE_NUMBA = os.environ.get("AUV_LSE_NUMBA", "1") != "0"
except ImportError:  # numba is optional by design
    HAVE_NUMBA = False


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function` compiled by numba (strict IEEE arithmetic, kept in numba's cache), or itself without numba."""
    if not HAVE_NUMBA:
        return function
    try:
        result: Callable[..., Any] = numba.njit(cache=True, fastmath=False)(function)
    except RuntimeError:  # numba found no place it may write its cache to
        result = numba.njit(fastmath=False)(function)
    return result


def plain(function: Callable[..., Any]) -> Callable[..., Any]:
    """The uncompiled function behind a compiled one (the reference of the tests)."""
    result: Callable[..., Any] = getattr(function, "py_func", function)
    return result
