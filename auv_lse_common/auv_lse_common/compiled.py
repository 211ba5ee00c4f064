"""Optional compilation: the inner loops run through numba where it is installed, and as plain Python where not.

The plain functions are the reference; tests call both (`function.py_func`) and compare them. The environment variable
AUV_LSE_NUMBA=0, set before the import, forces the plain ones.

Numba's cache keeps what was compiled until the function's own file changes; what it called in another file stays as it
was then. So the cache's folder is named after the text of all files of the package that hold compiled functions.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

try:
    import numba

    HAVE_NUMBA = os.environ.get("AUV_LSE_NUMBA", "1") != "0"
except ImportError:  # numba is optional by design
    HAVE_NUMBA = False


@cache
def cache_folder(package: Path) -> str:
    """Where numba keeps what it compiles of these very files of `package` (its folder, with all below it)."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        text = path.read_bytes()
        if b"@compiled" in text:
            digest.update(text)
    base = Path(numba.config.CACHE_DIR) if numba.config.CACHE_DIR else package / "__pycache__"
    return str(base / f"numba_{digest.hexdigest()[:16]}")


def _package_of(file: Path) -> Path:
    """Folder of the outermost package that `file` belongs to."""
    folder = file.parent
    while (folder.parent / "__init__.py").is_file():
        folder = folder.parent
    return folder


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function` compiled by numba (strict IEEE arithmetic, kept in numba's cache), or itself without numba."""
    if not HAVE_NUMBA:
        return function
    before = numba.config.CACHE_DIR
    folder = cache_folder(_package_of(Path(function.__code__.co_filename).resolve()))
    numba.config.CACHE_DIR = folder  # read when a function is decorated; unwritable: numba looks elsewhere
    try:
        result: Callable[..., Any] = numba.njit(cache=True, fastmath=False)(function)
    except RuntimeError:  # numba found no place it may write its cache to
        result = numba.njit(fastmath=False)(function)
    finally:
        numba.config.CACHE_DIR = before
    return result


def plain(function: Callable[..., Any]) -> Callable[..., Any]:
    """The uncompiled function behind a compiled one (the reference of the tests)."""
    result: Callable[..., Any] = getattr(function, "py_func", function)
    return result
