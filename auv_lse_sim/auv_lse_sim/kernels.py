"""Compilation of the simulator's inner loops, with a cache that notices a change in any of them.

Numba's cache keeps what was compiled until the function's own file changes; what it called in another file stays as it
was then. So the cache's folder is named after the text of all files of this package that hold compiled functions.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from auv_lse_planner.compiled import HAVE_NUMBA
from auv_lse_planner.compiled import compiled as compiled_alone

F = TypeVar("F", bound=Callable[..., Any])


@cache
def _cache_folder() -> str:
    """Where numba keeps what it compiles of these very files."""
    import numba

    package = Path(__file__).resolve().parent
    digest = hashlib.sha256()
    for path in sorted(package.glob("*.py")):
        text = path.read_bytes()
        if b"@compiled" in text:
            digest.update(text)
    base = Path(numba.config.CACHE_DIR) if numba.config.CACHE_DIR else package / "__pycache__"
    return str(base / f"numba_{digest.hexdigest()[:16]}")


@contextlib.contextmanager
def _own_cache() -> Iterator[None]:
    import numba

    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = _cache_folder()  # read when a function is decorated; unwritable: numba looks elsewhere
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before


def compiled(function: F) -> F:
    """`function` compiled by numba, or itself without numba."""
    if not HAVE_NUMBA:
        return function
    with _own_cache():
        result: F = compiled_alone(function)  # type: ignore[assignment]  # it looks the same from outside
    return result
