"""Results files: one mission per line, as JSON; lines are appended, so no mission is simulated twice."""

import json
import multiprocessing
import signal
import tempfile
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

#: Where results files go unless a command says otherwise: in the folder of runs, which git leaves alone.
FOLDER = Path("runs/benchmarks")


def read(path: Path) -> list[dict[str, Any]]:
    """Lines of a results file; none if there is no file yet.

    Raises:
        ValueError: naming a damaged line, such as one that a full disk has cut off.
    """
    lines = []
    for number, text in enumerate(path.read_text().splitlines() if path.exists() else (), 1):
        try:
            lines.append(json.loads(text))
        except json.JSONDecodeError as error:
            raise ValueError(f"{path}:{number}: this line is damaged ({error}); delete it and repeat.") from error
    return lines


def _append(path: Path, text: str) -> None:
    """Adds to a results file; raises OSError, naming it."""
    try:
        with path.open("a") as file:
            file.write(text)
    except OSError as error:  # that of a full disk names no file
        raise OSError(error.errno, error.strerror, str(path)) from error


def _begin(scratch: str) -> None:
    """In a process of the pool: Ctrl-C ends it silently; its temporary files are in `scratch`."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    tempfile.tempdir = scratch


def fly(
    mission: Callable[..., dict[str, Any]],
    jobs: Iterable[tuple[Any, ...]],
    path: Path,
    processes: int,
    failed: Callable[[ValueError], None] | None = None,
) -> Iterator[dict[str, Any]]:
    """Calls `mission` with the arguments of each job, some at once, and yields each line after it is written.

    A terminating signal ends missions under way silently; the lines of the others stay.

    Args:
        failed: Takes the error of a mission, and the others go on; None: the first error ends all.

    Raises:
        ValueError: if a process is killed, or that of a mission without `failed`.
        OSError: if the file cannot be written, naming it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    _append(path, "")
    with (
        tempfile.TemporaryDirectory(prefix="auv_lse_flights_") as scratch,
        ProcessPoolExecutor(processes, initializer=partial(_begin, scratch)) as pool,
    ):
        others, workers = multiprocessing.active_children(), list[BaseProcess]()
        try:
            futures = [pool.submit(mission, *job) for job in jobs]
            workers += [child for child in multiprocessing.active_children() if child not in others]
            for future in as_completed(futures):
                error = future.exception()
                if failed and isinstance(error, ValueError):
                    failed(error)
                    continue
                line = future.result()
                _append(path, json.dumps(line) + "\n")
                yield line
        except BaseException as error:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in workers:
                process.terminate()
            if isinstance(error, BrokenProcessPool):
                raise ValueError(
                    f"the process of a mission was killed, perhaps because memory ran out; {path} keeps the missions "
                    "that ended. Run the same command again, with fewer --processes if there are several"
                ) from error
            raise
