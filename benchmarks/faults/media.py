"""Disk failures of a vehicle: an ext4 error makes it read-only, its folder is deleted, or it is completely full.

The disk is an ext4 file system of its own (a loop device), so this needs root on Linux. The error is the kernel's own
(`trigger_fs_error`): it makes the disk read-only while files are open for writing, as a failing card does. Each moment
is a new dive, under way, on hold or aborted. Then a node is killed, or the power fails and the programs start again on
the broken disk.
"""

import argparse
import contextlib
import math
import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from auv_lse_common.support.option_types import whole_from
from benchmarks.command import call_as_root
from benchmarks.faults.bed.dive_bed import BACK_S, BOOTED_S, NODES, DiveBed, dive_bed
from benchmarks.faults.report import Moments, Report

SMALL = ("--moments", "6")
#: safety_node has to run again within this time (s).
SAFETY_BACK_S = 5.0
_POWER = "power failure"
_ORDERS = ("", "HOLD", "ABORT")
_DISK_BYTES = 64 * 2**20


@contextmanager
def disk(folder: Path) -> Iterator[Path]:
    """A new disk for as long as the context lasts: a folder that is an ext4 file system.

    Raises:
        RuntimeError: if this process may not mount one.
    """
    image, mounted = folder.with_suffix(".image"), folder
    mounted.mkdir(parents=True)
    with image.open("wb") as file:
        file.truncate(_DISK_BYTES)
    try:
        call_as_root("faults media", "mkfs.ext4", "-q", "-F", "-m", "0", str(image))
        call_as_root("faults media", "mount", "-o", "loop,errors=remount-ro", str(image), str(mounted))
        try:
            yield mounted
        finally:
            call_as_root("faults media", "umount", "-l", str(mounted))
    finally:
        image.unlink()


def make_read_only(mounted: Path) -> None:
    """An error of the file system, after which the kernel refuses every write, also to open files."""
    lines = (line.split() for line in Path("/proc/mounts").read_text().splitlines())
    device = next(fields[0] for fields in lines if fields[1] == str(mounted))
    Path(f"/sys/fs/ext4/{Path(device).name}/trigger_fs_error").write_text("1")


def delete(mounted: Path) -> None:
    """Deletes all that is on the disk, while it is in use."""
    for path in mounted.iterdir():
        shutil.rmtree(path, ignore_errors=True)


def fill(mounted: Path) -> None:
    """Fills the disk to the last byte, in few writes: meanwhile the vehicle receives no odometry."""
    for size in (2**20, 4096, 256, 16, 1):
        with contextlib.suppress(OSError), (mounted / "filling").open("ab", buffering=0) as file:
            while True:
                file.write(bytes(size))
                os.fsync(file.fileno())


FAULTS: dict[str, Callable[[Path], None]] = {"read-only": make_read_only, "deleted": delete, "full": fill}


def break_disk(bed: DiveBed, mounted: Path, fault: str, node: str, order: str) -> tuple[float, list[str]]:
    """Breaks the disk of a dive that has begun; returns the recovery time (s) and what went wrong.

    Args:
        fault: A key of `FAULTS`.
        node: The node that is killed, or `_POWER`.
        order: The command before it: "", HOLD or ABORT.
    """
    from auv_lse_msgs.msg import MissionCommand, MissionState

    vehicle, wrong = bed.vehicles[1], []
    water = vehicle.witness
    if not bed.obeys(order):
        wrong.append(f"{order} was not obeyed")
    before = water.state.state
    FAULTS[fault](mounted)
    bed.spend(0.5)
    if node == _POWER:
        back_s = _restart(bed)
    else:
        vehicle.kill(node)
        back_s = bed.wait(lambda: node in vehicle.running.nodes and water.has_restarted([node]), BACK_S)
    if math.isnan(back_s):
        return back_s, [*wrong, "never back"]
    bed.wait(lambda: water.state is not None, 5.0)
    bed.spend(1.5)  # more than safety.patience_s
    if (state := water.state) is None:
        return math.nan, [*wrong, "no state of the mission"]
    if node != _POWER and state.state != before:
        wrong.append(f"state {before} before, {state.state} after: {state.reason}")
    if node == _POWER and state.action == MissionState.TRAVEL:
        wrong.append(f"travels after a power failure: {state.reason}")
    if node in ("safety_node", _POWER) and back_s > SAFETY_BACK_S:
        wrong.append(f"safety_node was back after {back_s:.1f} s")
    for command in ("SURFACE", "ABORT"):
        if not water.is_in(MissionState.ABORTED):
            water.order(getattr(MissionCommand, command))
            done = {"SURFACE": lambda: water.state.action == MissionState.SURFACE}.get(
                command, lambda: water.is_in(MissionState.ABORTED)
            )
            if math.isnan(bed.wait(done, 5.0)):
                wrong.append(f"{command} was not obeyed on the broken disk")
    text = "".join(vehicle.program.text) if vehicle.program is not None else ""
    reported = text.count("log files cannot be written")
    if reported > 1 or (fault == "read-only" and not reported):  # a folder is made again, a dropped journal frees space
        wrong.append(f"the terminal says {reported} times that log files cannot be written")
    return back_s, wrong


def _restart(bed: DiveBed) -> float:
    """Cuts the power and starts the programs again; returns the time (s) until safety_node runs, NaN if never."""
    vehicle = bed.vehicles[1]
    vehicle.cut_power()
    vehicle.launch()
    began_s = time.monotonic()
    bed.wait(lambda: "safety_node" in vehicle.running.nodes or vehicle.running.process.poll() is not None, BOOTED_S)
    back_s = time.monotonic() - began_s
    if next(iter(vehicle.running.nodes), "") != "safety_node":
        return math.nan
    bed.wait(vehicle.has_started, BOOTED_S)
    return math.nan if math.isnan(bed.wait(lambda: vehicle.witness.has_restarted(NODES), BOOTED_S)) else back_s


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `faults media`."""
    parser.add_argument(
        "--moments", type=whole_from(1), default=60, metavar="N", help="how many (default: %(default)s; 20 s each)"
    )


def run(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Report:
    """Breaks a disk `--moments` times, in turn in each way, and kills each node or cuts the power in turn."""
    rng, moments, killed = np.random.default_rng(options.seed), Moments(say), (*NODES, _POWER)
    with dive_bed(folder) as bed:
        for number in range(options.moments):
            fault = tuple(FAULTS)[number % len(FAULTS)]
            node = killed[number // len(FAULTS) % len(killed)]
            order = _ORDERS[int(rng.integers(len(_ORDERS)))]
            with disk(folder / f"disk{number}") as mounted:
                bed.dive(runs=mounted / "runs")
                ledger = bed.vehicles[1].witness.ledger
                ledger.broken.clear()  # late messages of the dive before
                back_s, wrong = break_disk(bed, mounted, fault, node, order)
                wrong += ledger.broken
                bed.end()
            moments.add(fault, f"{fault} disk, {order or 'under way'}, {node}", back_s, wrong)
    return moments.report("disk", "every node came back, and HOLD, SURFACE and ABORT were obeyed")
