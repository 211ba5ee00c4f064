"""A default mission against the baseline's, flown in turn: `auv_lse bench mission`.

The baseline is a commit: its own code flies the same mission in the same minutes, from a checkout of its own under
`build/`. So neither the machine nor its speed, which changes from hour to hour, counts. A part that takes more than
`MOST_GROWTH` times the baseline's processor time fails the command, and so does a mission that takes more than
`MOST_TOTAL` times that of the fastest baseline so far.
"""

from __future__ import annotations

import json
import os
import shutil
import statistics
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from auv_lse_common.support.atomic_files import write_whole
from benchmarks.mission_parts import PARTS, parts_s
from benchmarks.rows import Row, row

#: This checkout.
ROOT = Path(__file__).resolve().parents[1]
#: The file that names the baseline.
BASELINE = Path(__file__).with_name("mission_baseline.json")
#: Largest processor time of a part relative to the baseline, and of the whole to the fastest baseline so far.
MOST_GROWTH, MOST_TOTAL = 1.15, 1.10
#: Missions flown with each, and how many if a part is too slow after the first ones: that may be noise.
PAIRS, MOST_PAIRS = 3, 6
#: Smaller growth (s) of a part does not count: in a short part, it is noise.
NOISE_S = 0.05
#: Variables that would give one checkout the other's code, or make it compile at every start.
CHECKOUT_VARIABLES = (
    "AMENT_PREFIX_PATH",
    "CMAKE_PREFIX_PATH",
    "COLCON_PREFIX_PATH",
    "LD_LIBRARY_PATH",
    "PYTHONPATH",
    "_ROS_WHEELS_BOOTSTRAP_COMPLETE",  # set where the wheels of ROS have found their libraries
)
ALWAYS_LEFT_OUT = ("PYTHONDONTWRITEBYTECODE", "PYTHONUNBUFFERED", "AUV_LSE_ROOT")
#: Measures in the checkout that it is run in.
MEASURE = ". scripts/environment.sh && use_environment && exec python -m benchmarks.mission_parts"


@dataclass(frozen=True, slots=True, kw_only=True)
class Baseline:
    """The commit that a mission is compared with.

    Attributes:
        commit: Its full name.
        reason: Why it is the baseline.
        of_fastest: Its processor time relative to that of the fastest baseline so far, at least 1.
    """

    commit: str
    reason: str
    of_fastest: float

    @classmethod
    def read(cls, path: Path = BASELINE) -> Baseline:
        """The one of the checkout."""
        return cls(**json.loads(path.read_text()))

    def write(self, path: Path = BASELINE) -> None:
        """Writes it to be committed."""
        write_whole(path, json.dumps({**asdict(self), "of_fastest": round(self.of_fastest, 3)}, indent=1) + "\n")


Pair = tuple[Mapping[str, float], Mapping[str, float]]


def compared(pairs: Sequence[Pair], of_fastest: float) -> list[Row]:
    """A row for each part, and one for the whole mission.

    Args:
        pairs: Processor times (s) of the parts of a mission, now and by the baseline, flown one after the other.
        of_fastest: As in `Baseline`.
    """
    rows = []
    for name in [name for name in PARTS if name in pairs[0][1]]:
        ratio = statistics.median(now[name] / max(before[name], 1e-9) for now, before in pairs)
        seconds = statistics.median(now[name] for now, _ in pairs)
        holds = ratio <= MOST_GROWTH or seconds * (1.0 - 1.0 / ratio) <= NOISE_S
        goal = f"<= {MOST_GROWTH:g}"
        rows.append(row(f"mission: {name}", seconds, "cpu s", "baseline", ratio, goal=goal, holds=holds))
    ratio = of_fastest * statistics.median(sum(now.values()) / sum(before.values()) for now, before in pairs)
    seconds = statistics.median(sum(now.values()) for now, _ in pairs)
    goal, against = f"<= {MOST_TOTAL:g}", "fastest baseline"
    return [*rows, row("mission: whole", seconds, "cpu s", against, ratio, goal=goal, holds=ratio <= MOST_TOTAL)]


def complaints(rows: list[Row]) -> list[str]:
    """The rows that fail the command, a sentence each."""
    return [
        f"{r['name'].removeprefix('mission: ')} takes {r['ratio']:.2f} times the processor time of the {r['against']}; "
        f"allowed: {r['goal']}"
        for r in rows
        if r["holds"] is False
    ]


def _git(*arguments: str, folder: Path | None = None) -> str:
    """Output of git in a folder (None: this checkout); raises RuntimeError if it is missing or fails."""
    try:
        done = subprocess.run(
            ["git", "-C", str(folder or ROOT), *arguments], capture_output=True, text=True, check=False
        )
    except FileNotFoundError as error:
        raise RuntimeError("bench mission needs git: the baseline is a commit") from error
    if done.returncode:
        raise RuntimeError(f"git {' '.join(arguments)} failed: {done.stderr.strip()}")
    return done.stdout.strip()


def checkout(commit: str, parent: Path = ROOT / "build") -> Path:
    """A checkout of a commit; the same one the next time. Those of earlier baselines go.

    Raises:
        RuntimeError: if this is not a clone that has the commit.
    """
    folder = parent / f"baseline-{commit[:8]}"
    try:
        _git("cat-file", "-e", f"{commit}^{{commit}}")
    except RuntimeError as error:
        cure = "Measure in a whole clone (git fetch --unshallow makes this one whole)"
        raise RuntimeError(f"the baseline is commit {commit[:8]}, which is not here ({error}). {cure}") from error
    for other in parent.glob("baseline-*"):
        if not other.is_dir():
            other.unlink()
        elif other != folder:
            shutil.rmtree(other)
    if not folder.exists():
        parent.mkdir(parents=True, exist_ok=True)
        _git("clone", "--quiet", "--shared", "--no-checkout", str(ROOT), str(folder))
    _git("checkout", "--quiet", "--force", "--detach", commit, folder=folder)
    return folder


def _environment() -> dict[str, str]:
    """The environment for both checkouts, each of which adds its own; a ROS 2 of the machine's own stays in it."""
    left_out = {*ALWAYS_LEFT_OUT, *(() if "ROS_DISTRO" in os.environ else CHECKOUT_VARIABLES)}
    return {name: value for name, value in os.environ.items() if name not in left_out}


def _flown_in(folder: Path) -> dict[str, float]:
    """Processor time (s) of the parts of a mission by the code of a checkout, which is set up first if needed."""
    command = ["bash", "-c", MEASURE]
    done = subprocess.run(command, cwd=folder, env=_environment(), stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{folder}: the measurement ended with {done.returncode}")
    times: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return times


def run(*, smoke: bool = False, new_baseline: str = "") -> list[Row]:
    """Measures and compares; writes a new baseline if a reason for one is given.

    A smoke run flies one vehicle for two steps and compares with nothing.

    Raises:
        RuntimeError: if a mission or a checkout fails, or if a new baseline is not committed.
    """
    if smoke:
        times = parts_s("--vehicles", "1", "--steps", "2")
        return [row(f"mission: {name}", times[name], "cpu s") for name in PARTS]
    if new_baseline and _git("status", "--porcelain", "--untracked-files=no"):
        raise RuntimeError("a baseline is a commit, and this checkout has changes. Commit them first")
    baseline = Baseline.read()
    folders = [ROOT, checkout(baseline.commit)]
    pairs: list[Pair] = []
    for number in range(MOST_PAIRS):
        if number == PAIRS and not complaints(compared(pairs, baseline.of_fastest)):
            break
        count = PAIRS if number < PAIRS else MOST_PAIRS
        print(f"pair {number + 1} of {count}, with {baseline.commit[:8]} ...", file=sys.stderr)
        order = folders if number % 2 else folders[::-1]  # neither is always the first
        flown = {folder: _flown_in(folder) for folder in order}
        pairs.append((flown[ROOT], flown[folders[1]]))
    rows = compared(pairs, baseline.of_fastest)
    if new_baseline:
        of_fastest = max(rows[-1]["ratio"], 1.0)
        Baseline(commit=_git("rev-parse", "HEAD"), reason=new_baseline, of_fastest=of_fastest).write()
    return rows
