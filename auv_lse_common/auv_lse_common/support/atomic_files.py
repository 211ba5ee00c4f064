"""Writes files atomically: completely or not at all."""

import contextlib
import errno
import fcntl
import os
import shutil
import signal
import stat
import sys
import tempfile
import threading
import time
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import TextIO

from auv_lse_common.support.ending_signals import SIGNALS

#: Prefix of the names of temporary folders.
_PART = ".auv_lse.part-"
#: Age (s) from which a temporary folder without a lock is left over.
_YOUNG_S = 60.0
#: Longest wait (s) for another process that moves files into the same folder, which takes milliseconds.
_WAIT_S = 10.0


@contextlib.contextmanager
def written_whole(folder: Path, obsolete: Collection[str] = ()) -> Iterator[Path]:
    """A context that provides an empty folder; at the end its files are moved into `folder`, created if needed.

    After an error `folder` is unchanged, or missing if it was. A signal during the move is answered after it.

    Args:
        obsolete: Patterns of files in `folder` that are then removed, unless they are new. It may grow meanwhile.

    Raises:
        OSError: naming `folder` or the file.
    """
    new = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with _part_folder(folder) as part:
            files = part / "files"  # not `part`, whose lock is held: files may be written whole into it
            files.mkdir()
            yield files
            _move(sorted(files.iterdir()), folder, obsolete)
    except BaseException as error:
        for path in new:
            with contextlib.suppress(OSError):  # not made, or it has files of others
                path.rmdir()
        if isinstance(error, OSError) and (error.filename is None or _PART in str(error.filename)):
            text = os.strerror(error.errno) if error.errno else str(error)  # HDF5's own names a hidden folder
            raise OSError(error.errno, text, str(folder)) from error
        raise


@contextlib.contextmanager
def _part_folder(folder: Path) -> Iterator[Path]:
    """A new temporary folder in `folder`, from which those of killed processes are removed."""
    with tempfile.TemporaryDirectory(prefix=_PART, dir=folder) as name, _locked(Path(name)):
        made_s = Path(name).stat().st_mtime  # the file system's clock
        for old in folder.glob(f"{_PART}*"):
            with contextlib.suppress(OSError):
                if made_s - old.stat().st_mtime > _YOUNG_S:
                    _remove_unlocked(old)
        yield Path(name)


def _remove_unlocked(folder: Path) -> None:
    with _locked(folder) as locked:
        if locked:
            shutil.rmtree(folder)


@contextlib.contextmanager
def _locked(folder: Path, wait_s: float = 0.0) -> Iterator[bool]:
    """Tries for `wait_s` to lock a folder until the context ends; the value is whether that succeeded."""
    with contextlib.ExitStack() as stack:
        locked, until_s = False, time.monotonic() + wait_s
        with contextlib.suppress(OSError):  # not a folder, or a file system without locks
            opened = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            stack.callback(os.close, opened)
            while not locked:
                try:
                    fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    locked = True
                except BlockingIOError:
                    if time.monotonic() >= until_s:
                        break
                    time.sleep(0.02)
        yield locked


def _move(paths: Sequence[Path], folder: Path, obsolete: Collection[str]) -> None:
    """Moves files into a folder, and removes others that match a pattern of `obsolete`."""
    names = {path.name for path in paths}
    for path in paths:
        target = folder / path.name
        if target.is_dir() and not target.is_symlink() and not path.is_dir():
            raise IsADirectoryError(errno.EISDIR, "is a folder in place of a file; remove it", str(target))
    with _locked(folder, _WAIT_S), _signals_answered_later():
        old = {path for pattern in obsolete for path in folder.glob(pattern) if path.name not in names}
        _check_owners(folder, [*(folder / path.name for path in paths), *sorted(old)])
        for path in paths:
            path.replace(folder / path.name)
        for path in old:
            path.unlink()


def _check_owners(folder: Path, paths: Sequence[Path]) -> None:
    """Raises PermissionError for a file that only another user may replace, because the folder is shared as /tmp is."""
    about, user = folder.stat(), os.geteuid()
    if not about.st_mode & stat.S_ISVTX or user in (0, about.st_uid):
        return
    for path in paths:
        with contextlib.suppress(FileNotFoundError):
            if path.lstat().st_uid != user:
                raise PermissionError(errno.EPERM, "belongs to another user; choose another folder", str(path))


@contextlib.contextmanager
def _signals_answered_later() -> Iterator[None]:
    """A context at whose end `SIGNALS` are answered that came meanwhile.

    Blocking them does not suffice: Linux then gives them to another thread, such as one of linear algebra, and Python
    answers in the main thread all the same.
    """
    came: list[int] = []
    taken = {n: h for n in SIGNALS if (h := signal.getsignal(n)) not in (signal.SIG_IGN, None)}
    if threading.current_thread() is not threading.main_thread():
        taken = {}  # no signal is answered here
    try:
        for number in taken:
            signal.signal(number, lambda number, frame: came.append(number))
        yield
    finally:
        for number, handler in taken.items():
            signal.signal(number, handler)
        for answered in came:
            signal.raise_signal(answered)


def check_folder(folder: Path) -> None:
    """Checks before a long computation that `written_whole` can write into a folder; changes nothing.

    Raises:
        OSError: naming what is in the way: a file instead of a folder, a folder that cannot be written, or a name that
            is too long.
    """
    for found in (folder, *folder.parents):
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            found.lstat()
            break
    if not found.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, "is not a folder; choose another name", str(found))
    if not os.access(found, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, "the folder cannot be written; choose another one with --out", str(found))


def check_file(path: Path, option: str) -> None:
    """Checks before a long computation that `write_whole` can write a file; changes nothing.

    Args:
        path: The file, device or pipe.
        option: The option that names it, such as `--csv`.

    Raises:
        ValueError: naming both: a folder or a loop of links in place of the file, or a folder that is missing or cannot
            be written.
    """
    if path.is_dir():
        raise ValueError(f"{option} {path}: this is a folder; name a file in it")
    if path.exists() and not path.is_file():
        return
    if path.is_symlink() and os.path.islink(os.path.realpath(path)):
        raise ValueError(f"{option} {path}: this is a symbolic link that leads to itself; choose another name")
    folder = (path.resolve() if path.is_symlink() else path).parent
    if not folder.is_dir():
        raise ValueError(f"{option} {path}: there is no folder {folder}. Create it, or choose another")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ValueError(f"{option} {path}: the folder {folder} cannot be written; choose another")


def write_whole(path: Path, text: str) -> None:
    """Writes a text file, and replaces an existing one, whose permissions it keeps; into a device or pipe at once.

    Standard output, as /dev/stdout, takes the text after what was printed to it, also if it is a file.

    Raises:
        OSError: naming the file, which is then unchanged.
    """
    try:
        for stream in (sys.stdout, sys.stderr):
            if _is_open_as(path, stream):
                stream.write(text)
                stream.flush()
                return
        if path.exists() and not path.is_file():
            path.write_text(text, newline="")
            return
        target = path.resolve()  # a link stays
        with _part_folder(target.parent) as folder:
            part = folder / "text"
            part.write_text(text, newline="")
            if target.exists():
                shutil.copymode(target, part)
            part.replace(target)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


def _is_open_as(path: Path, stream: TextIO | None) -> bool:
    """Whether a file is where a stream goes."""
    try:
        return stream is not None and os.path.samestat(path.stat(), os.fstat(stream.fileno()))
    except (OSError, ValueError):  # there is no such file; the stream is closed, or goes to none
        return False
