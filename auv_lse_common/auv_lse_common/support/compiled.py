"""Compiles inner loops with numba if it is installed; otherwise they run as plain Python or NumPy.

The plain functions are the reference, with which tests compare the compiled ones. The environment variable
AUV_LSE_NUMBA=0, set before the import, forces the plain ones.

Numba's cache detects changes of a function's own file, but not of functions that it calls in other files. So the name
of the cache folder contains a hash of all files of the package with compiled functions.

Numba uses no cache that it cannot write, and would compile at each start where the packages are read-only, as on a
vehicle at boot. There the cache that set-up made is copied to a folder that can be written.
"""

import contextlib
import hashlib
import importlib.util
import os
import shutil
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
    """Puts numba's cache under /tmp if neither this package nor the home's cache is writable.

    Code in the cache is run, and anyone can create folders in /tmp: one that others own or can write is not used, but
    a new one of this process alone.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    if os.access(Path(__file__).parent, os.W_OK):
        return
    home = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    with contextlib.suppress(OSError):
        (home / "auv_lse").mkdir(exist_ok=True, parents=True)
    if os.access(home / "auv_lse", os.W_OK):
        os.environ["NUMBA_CACHE_DIR"] = str(home / "auv_lse")
        return
    folder = Path(tempfile.gettempdir()) / f"auv_lse_numba_{os.getuid()}"
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    os.environ["NUMBA_CACHE_DIR"] = str(folder) if _is_private(folder) else tempfile.mkdtemp(prefix=folder.name)


def _is_private(folder: Path) -> bool:
    """Whether this is a folder (not a link) that belongs to this user and that only this user can write to."""
    found = folder.lstat()
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022


if USE_NUMBA:
    with contextlib.suppress(OSError):  # no folder to write to: compiled at each start
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
    made_by_setup = package / "__pycache__" / f"numba_{digest.hexdigest()[:16]}"
    if not numba.config.CACHE_DIR:
        return str(made_by_setup)
    folder = Path(numba.config.CACHE_DIR) / made_by_setup.name
    _copy_cache(made_by_setup, folder)
    return str(folder)


def copy_compiled(module_file: str) -> None:
    """Copies what set-up compiled for the modules of a folder to numba's cache, if the folder is read-only.

    For modules that call `numba.njit` themselves. Call it before they are imported.

    Args:
        module_file: `__file__` of one of the modules.
    """
    if USE_NUMBA and "NUMBA_CACHE_DIR" in os.environ:
        folder = Path(os.path.abspath(module_file)).parent
        name = f"{folder.name}_{hashlib.sha1(str(folder).encode()).hexdigest()}"  # as numba calls it
        _copy_cache(folder / "__pycache__", Path(os.environ["NUMBA_CACHE_DIR"]) / name)


def _copy_cache(made_by_setup: Path, folder: Path) -> None:
    """Copies a cache that cannot be written, unless a copy as new as it is there; does nothing if there is no room."""
    if not made_by_setup.is_dir() or os.access(made_by_setup, os.W_OK):
        return
    with contextlib.suppress(OSError):  # no room, or another process was faster
        if folder.exists() and folder.stat().st_mtime >= made_by_setup.stat().st_mtime:
            return
        copy = tempfile.mkdtemp(dir=folder.parent)
        shutil.copytree(made_by_setup, copy, dirs_exist_ok=True, ignore=shutil.ignore_patterns("*.pyc"))
        shutil.rmtree(folder, ignore_errors=True)
        os.rename(copy, folder)


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
    file = Path(function.__code__.co_filename).resolve()
    function.__code__ = function.__code__.replace(co_filename=str(file))  # numba's cache goes by it: one for all links
    folder = cache_folder(_package_of(file))
    numba.config.CACHE_DIR = folder  # read when a function is decorated; if it is not writable, numba looks elsewhere
    try:
        result: Callable[..., Any] = numba.njit(cache=True, fastmath=False)(function)
        _save_if_possible(result)
    except RuntimeError:  # numba found no writable cache folder
        result = numba.njit(fastmath=False)(function)
    finally:
        numba.config.CACHE_DIR = before
    return result


def _save_if_possible(dispatcher: Any) -> None:
    """Makes a function compiled on a full disk run: numba raises when it cannot save its code."""
    save = dispatcher._cache.save_overload

    def save_if_possible(signature: Any, data: Any) -> None:
        with contextlib.suppress(OSError):
            save(signature, data)

    dispatcher._cache.save_overload = save_if_possible


def plain(function: Callable[..., Any]) -> Callable[..., Any]:
    """The plain function of a compiled one."""
    result: Callable[..., Any] = getattr(function, "py_func", function)
    return result
