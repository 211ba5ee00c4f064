"""Power loss: every program of a vehicle is killed at a random moment, its files are damaged, and it starts again.

Journals are cut at any byte. One time in two a state file or the record of the dive is damaged as well: cut, its newest
slot half written, filled with zeros, or removed. Sometimes the whole run folder is removed.
"""

import argparse
import math
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from auv_lse_common.node.state_slots import FILE_BYTES, SLOT_BYTES
from auv_lse_common.support.option_types import whole_from
from benchmarks.faults.bed.dive_bed import BOOTED_S, NODES, DiveBed, Vehicle, dive_bed
from benchmarks.faults.report import Moments, Report

SMALL = ("--moments", "20")
_ORDERS = ("", "", "HOLD", "ABORT")


def cut(path: Path, rng: np.random.Generator) -> None:
    """Truncates a file at any byte."""
    with path.open("r+b") as file:
        file.truncate(int(rng.integers(path.stat().st_size + 1)))


#: Kinds of damage to a state file, and to the whole run folder.
_DAMAGE = ("torn", "zeroed", "removed")
_RUN_FOLDER = "run folder"


def spoil(path: Path, how: str, rng: np.random.Generator) -> None:
    """Damages a state file in one of the ways of `_DAMAGE`."""
    if how == "torn":
        tear(path, rng)
    elif how == "zeroed":
        path.write_bytes(bytes(path.stat().st_size))
    else:
        path.unlink()


def tear(path: Path, rng: np.random.Generator) -> None:
    """Damages a state file: cuts it, or writes its newest slot only in part."""
    data = bytearray(path.read_bytes())
    slots = (0, SLOT_BYTES)
    newest = max(slots, key=lambda slot: int.from_bytes(data[slot + 8 : slot + 16], "little"))
    if rng.random() < 0.5 or len(data) != FILE_BYTES:
        del data[int(rng.integers(len(data))) :]
    else:
        length = 24 + int.from_bytes(data[newest + 16 : newest + 20], "little")
        position = newest + int(rng.integers(length))
        data[position : newest + length] = rng.bytes(newest + length - position)
    path.write_bytes(data)


def damage(vehicle: Vehicle, rng: np.random.Generator) -> str:
    """Damages the files of a dive; returns which state file and how, "" if none is, `_RUN_FOLDER` if all are gone."""
    for journal in sorted(vehicle.out.glob("journal/*/*.journal")):
        cut(journal, rng)
    if rng.random() < 0.5:
        return ""
    if rng.random() < 0.2:
        shutil.rmtree(vehicle.out)
        return _RUN_FOLDER
    files = [*sorted(vehicle.out.glob("journal/*/*.state")), vehicle.out / "auv1.dive"]
    path, how = files[int(rng.integers(len(files)))], _DAMAGE[int(rng.integers(len(_DAMAGE)))]
    spoil(path, how, rng)
    return f"{path.name} {how}"


def reboot(bed: DiveBed, after_reboot: str, rng: np.random.Generator) -> tuple[str, float, list[str]]:
    """Cuts the power once; returns a description, the time until the mission state is back (s), and what went wrong."""
    from auv_lse_msgs.msg import MissionState

    vehicle, wrong = bed.vehicles[1], []
    water = vehicle.witness
    bed.spend(rng.uniform(0.5, 4.0))
    order = _ORDERS[rng.integers(len(_ORDERS))]
    if not bed.obeys(order):
        wrong.append(f"{order} was not obeyed")
    bed.spend(rng.uniform(0.0, 0.5))
    before = water.state.state
    vehicle.cut_power()
    torn = damage(vehicle, rng)
    what = f"{after_reboot}, {order or 'under way'}, {torn or 'journals cut'}"
    began_s = time.monotonic()
    try:
        bed.start(vehicle)
    except RuntimeError as error:
        return what, math.nan, [*wrong, str(error)]
    has_restarted = bed.wait(lambda: water.has_restarted(NODES), BOOTED_S)
    back_s = math.nan if math.isnan(has_restarted) else time.monotonic() - began_s
    bed.wait(lambda: water.state is not None, 10.0)
    bed.spend(2.5)  # more than safety.patience_s
    state = water.state
    if state is None or math.isnan(back_s):
        return what, math.nan, [*wrong, "never back"]
    surfaced = state.action == MissionState.SURFACE
    if before == MissionState.ABORTED and torn.split()[0:1] not in (["auv1.safety_node.state"], ["auv1.dive"], ["run"]):
        good = state.state == MissionState.ABORTED
    elif before == MissionState.RUNNING and after_reboot == "resume" and not torn:
        good = state.state == MissionState.RUNNING
    else:
        good = surfaced
    if not good:
        wrong.append(f"state {before} before; {state.state}, action {state.action} after: {state.reason}")
    return what, back_s, wrong


def resume(bed: DiveBed) -> bool:
    """Resumes the mission, if its state is trusted; returns whether steps are decided again."""
    return "not trusted" not in bed.vehicles[1].witness.problems and bed.resume()


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `auv_lse faults reboot`."""
    parser.add_argument(
        "--moments", type=whole_from(1), default=20, metavar="N", help="how many (default: %(default)s; 15 s each)"
    )


def run(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Report:
    """Cuts the power `--moments` times."""
    rng, moments = np.random.default_rng(options.seed), Moments(say)
    after_reboot, resumed = "", False
    with dive_bed(folder) as bed:
        witness = bed.vehicles[1].witness
        ledger = witness.ledger
        for _ in range(options.moments):
            if not resumed:
                after_reboot = ("resume", "surface")[int(rng.integers(2))]
                bed.dive(after_reboot)
            broken = len(ledger.broken)
            what, back_s, wrong = reboot(bed, after_reboot, rng)
            resumed = not math.isnan(back_s) and resume(bed)
            if not resumed and not wrong and "not trusted" not in witness.problems:
                wrong.append("the mission did not resume after GO")
            damaged = what.rpartition(", ")[2]
            kind = damaged if damaged in (_RUN_FOLDER, "journals cut") else f"a file {damaged.split()[1]}"
            moments.add(kind, what, back_s, wrong + ledger.broken[broken:])
        packets = len(ledger.slots)
    end = f"no step decided twice, no abort forgotten, {packets} packets, each with a counter of its own"
    return moments.report("damaged", end)
