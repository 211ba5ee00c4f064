"""Compiles inner loops with numba if it is installed; otherwise they run as plain Python or NumPy.

The plain functions are the reference, with which tests compare the compiled ones. The environment variable
AUV_LSE_NUMBA=0, set before the import, forces the plain ones.

Numba's cache detects changes of a function's own file, but not of functions that it calls in other files. So the name
of the cache folder contains a hash of all files of the package with compiled functions.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import os
import stat
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

#: Whether compiled code is used. `compiled` reads it when a function is decorated; auv_lse_gp reads it at every call,
#: so that tests can switch it.
USE_NUMBA = os.environ.get("AUV_LSE_NUMBA", "1") != "0" and importlib.util.find_spec("numba") is not None


def _choose_cache_folder() -> None:
    """Puts numba's cache under /tmp if neither this package nor the home is writable.

    Code in the cache is run, and anyone can create folders in /tmp: one that others own or can write is not used, but
    a new one of this process alone.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    package, home = Path(__file__).parent, Path(os.environ.get("XDG_CACHE_HOME", os.path.expanduser("~")))
    if any(os.access(folder, os.W_OK) for folder in (package, home)):
        return
    folder = Path(tempfile.gettempdir()) / f"auv_lse_numba_{os.getuid()}"
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    os.environ["NUMBA_CACHE_DIR"] = str(folder) if _is_private(folder) else tempfile.mkdtemp(prefix=folder.name)


def _is_private(folder: Path) -> bool:
    """Whether this is a folder (not a link) that belongs to this user and that nobody else can write to."""
    found = folder.lstat()
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022


if USE_NUMBA:
    with contextlib.suppress(OSError):  # no position to write: compiled at each start
        _choose_cache_folder()


@cache
def cache_folder(package: Path) -> str:
    """Numba's cache folder for the current files of `package` (its folder)."""
    import numba

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
    """`function` compiled by numba (strict IEEE arithmetic, cached), or `function` itself without numba."""
    if not USE_NUMBA:
        return function
    import numba  # here, because numba is optional

    before = numba.config.CACHE_DIR
    folder = cache_folder(_package_of(Path(function.__code__.co_filename).resolve()))
    numba.config.CACHE_DIR = folder  # read when a function is decorated; if it is not writable, numba looks elsewhere
    try:
        result: Callable[..., Any] = numba.njit(cache=True, fastmath=False)(function)
    except RuntimeError:  # numba found no writable cache folder
        result = numba.njit(fastmath=False)(function)
    finally:
        numba.config.CACHE_DIR = before
    return result


def plain(function: Callable[..., Any]) -> Callable[..., Any]:
    """The plain function of a compiled one."""
    result: Callable[..., Any] = getattr(function, "py_func", function)
    return result
