"""A full disk: writes fail at random moments, and random nodes are killed then.

A limit on the size of files (RLIMIT_FSIZE) stands in for the disk: files that have their size can be written, others
cannot grow. One time in four the limit is 0, as on a disk that became read-only: nothing can be written.
"""

import argparse
import contextlib
import math
import resource
from collections.abc import Callable
from pathlib import Path

import numpy as np

from auv_lse_common.node.state_slots import FILE_BYTES
from auv_lse_common.support.option_types import whole_from
from benchmarks.faults.bed.dive_bed import BACK_S, NODES, DiveBed, Vehicle, dive_bed
from benchmarks.faults.report import Moments, Report

SMALL = ("--moments", "20")
#: A file that cannot be written has to be in the diagnostics within this time (s).
REPORTED_S = 12.0
_ORDERS = ("", "HOLD", "ABORT")


def set_limit(vehicle: Vehicle, limit: int) -> None:
    """Sets the largest size of files for every process of the vehicle."""
    for pid in vehicle.pids():
        with contextlib.suppress(ProcessLookupError):
            _, most = resource.prlimit(pid, resource.RLIMIT_FSIZE)
            resource.prlimit(pid, resource.RLIMIT_FSIZE, (limit, most))


def fill(bed: DiveBed, node: str, rng: np.random.Generator) -> tuple[str, float, list[str]]:
    """Fills the disk and kills a node; returns a description, the recovery time (s) and what went wrong."""
    from auv_lse_msgs.msg import MissionState

    vehicle, wrong = bed.vehicles[1], []
    water = vehicle.witness
    bed.spend(rng.uniform(0.5, 3.0))
    limit = 0 if rng.random() < 0.25 else FILE_BYTES
    water.problems.clear()
    set_limit(vehicle, limit)
    reported_s = bed.wait(lambda: "cannot be written" in water.problems, REPORTED_S)
    order = _ORDERS[rng.integers(len(_ORDERS))]
    if not bed.obeys(order):
        wrong.append(f"{order} was not obeyed on a full disk")
    before = water.state.state
    what = f"{'read-only' if limit == 0 else 'full'} disk, {order or 'no order'}, {node} killed"
    is_full = any(file.stat().st_size > limit - 1000 for file in vehicle.out.glob("journal/*/*.journal"))
    if math.isnan(reported_s) and is_full:
        wrong.append(f"not reported within {REPORTED_S:g} s")
    bed.spend(rng.uniform(0.0, 0.5))
    vehicle.kill(node)
    back_s = bed.wait(lambda: water.has_restarted([node]), BACK_S)
    bed.wait(lambda: water.state is not None, 5.0)
    bed.spend(1.5)
    state = water.state
    if math.isnan(back_s) or state is None:
        return what, math.nan, [*wrong, "never back"]
    if node == "safety_node" and limit == 0:  # its state cannot be trusted
        if state.action != MissionState.SURFACE:
            wrong.append(f"without trusted state: state {state.state}, action {state.action}, instead of surfacing")
    elif state.state != before:
        wrong.append(f"state {before} before, {state.state} after")
    return what, back_s, wrong


def recover(bed: DiveBed) -> bool:
    """Gives the disk its space back and resumes the mission; returns whether steps are decided again."""
    set_limit(bed.vehicles[1], resource.RLIM_INFINITY)
    return bed.resume()


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `auv_lse faults disk`."""
    parser.add_argument(
        "--moments", type=whole_from(1), default=20, metavar="N", help="how many (default: %(default)s; 10 s each)"
    )


def run(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Report:
    """Fills the disk `--moments` times and kills a node each time."""
    rng, moments = np.random.default_rng(options.seed), Moments(say)
    resumed, node = False, ""
    with dive_bed(folder) as bed:
        vehicle = bed.vehicles[1]
        ledger = vehicle.witness.ledger
        for _ in range(options.moments):
            if vehicle.program is None or not resumed:
                bed.dive()
            broken = len(ledger.broken)
            node = str(rng.choice([other for other in NODES if other != node]))  # the keeper delays repeated restarts
            what, back_s, wrong = fill(bed, node, rng)
            resumed = recover(bed) if not math.isnan(back_s) else False
            moments.add(f"`{node}`", what, back_s, wrong + ledger.broken[broken:])
        packets = len(ledger.slots)
    return moments.report("killed on a full disk", f"{packets} packets, each with a counter of its own")
