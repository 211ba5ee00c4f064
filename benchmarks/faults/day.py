"""A working day of one vehicle: kills of its nodes and power losses at random steps; nothing may be lost.

Its nodes are real, and the water moves it faster than real time. The nodes' clock is that of the wall, so their periods
(slots, health, the lead of a decision) are not shortened. The speed-up that the machine sustains is measured.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.faults.dive_bed import BACK_S, BOOTED_S, NODES, DiveBed, dive_bed
from benchmarks.faults.kills import LEG_S
from benchmarks.faults.report import Report

#: Speed (m/s) at which a leg takes `LEG_S`.
SPEED_MPS = 1.5
#: A leg may take so many times its time, and so much more (s): a decision's lead, and a restart.
SLOW, SPARE_S = 6.0, 60.0


def schedule(legs: int, kills: int, reboots: int, rng: np.random.Generator) -> list[tuple[int, str]]:
    """Faults in order: the step after which each happens, and the node that is killed, "" for a power loss.

    Each has a step of its own; a node is not killed twice in a row, because the keeper delays repeated restarts.
    """
    count = kills + reboots
    steps = np.sort(rng.choice(np.arange(1, max(legs - 2, count + 1)), count, replace=False))
    lost_power = set(rng.choice(count, reboots, replace=False).tolist())
    faults: list[tuple[int, str]] = []
    node = ""
    for number, step in enumerate(steps.tolist()):
        node = "" if number in lost_power else str(rng.choice([other for other in NODES if other != node]))
        faults.append((step, node))
    return faults


def strike(bed: DiveBed, node: str) -> tuple[float, list[str]]:
    """Kills a node, or cuts the power; returns the time until it is back (s), and what went wrong."""
    from auv_lse_msgs.msg import MissionState

    water = bed.witness
    water.forget()
    began_s = time.monotonic()
    if node:
        bed.kill(node)
        back_s = water.back([node], BACK_S)
    else:
        bed.cut_power()
        try:
            bed.start()
        except RuntimeError as error:
            return math.nan, [str(error)]
        back_s = water.back(NODES, BOOTED_S)
        back_s = math.nan if math.isnan(back_s) else time.monotonic() - began_s
    if math.isnan(back_s):
        return back_s, ["never back"]
    water.wait(lambda: water.is_in(MissionState.RUNNING, MissionState.ENDED), BACK_S)
    if water.state is None or water.state.state not in (MissionState.RUNNING, MissionState.ENDED):
        return back_s, [f"state {water.state and water.state.state} after it; expected RUNNING"]
    step = water.last_step
    patience_s = SPARE_S + SLOW * LEG_S
    if water.state.state == MissionState.RUNNING and math.isnan(water.wait(lambda: water.last_step > step, patience_s)):
        return back_s, [f"no decision within {patience_s:.0f} s"]
    return back_s, []


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `scripts/faults day`."""
    parser.add_argument("--hours", type=float, default=5.0, metavar="H", help="mission time (default: %(default)s)")
    parser.add_argument("--speed-up", type=float, default=50.0, metavar="X", help="aim (default: %(default)s)")
    parser.add_argument("--method", default="tour", metavar="NAME", help="planning method (default: %(default)s)")
    parser.add_argument("--kills", type=int, default=10, metavar="N", help="kills of nodes (default: %(default)s)")
    parser.add_argument("--reboots", type=int, default=2, metavar="N", help="power losses (default: %(default)s)")


def run(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Report:
    """Flies the day; the report has the speed-up between faults."""
    legs = max(options.kills + options.reboots + 4, round(options.hours * 3600.0 / LEG_S))
    rows: dict[str, list[float]] = {}
    lost: list[str] = []
    survived = 0
    away_s = 0.0
    with dive_bed(folder, say) as bed:
        water = bed.witness
        bed.dive("resume", legs, SPEED_MPS * options.speed_up, options.method)
        began_s, first = time.monotonic(), water.last_step
        faults = schedule(legs, options.kills, options.reboots, np.random.default_rng(options.seed))

        def await_step(wanted: int) -> None:
            while water.last_step < wanted:
                step = water.last_step
                if math.isnan(water.wait(lambda: water.last_step > step, SPARE_S + SLOW * LEG_S)):  # noqa: B023
                    raise RuntimeError(f"no decision after step {step}; see {bed.out / 'logs'}")

        for step, node in faults:
            await_step(step)
            broken, struck_s = len(water.broken), time.monotonic()
            back_s, wrong = strike(bed, node)
            away_s += time.monotonic() - struck_s
            wrong += water.broken[broken:]
            survived += not wrong
            what = node or "power loss"
            lost += [f"{what} at step {step}: {text}" for text in wrong]
            rows.setdefault(what, []).append(back_s)
            say(f"step {water.last_step} of {legs}: {what}: back after {back_s:.1f} s; {'; '.join(wrong)}")
        await_step(legs - 1)
        flown_s = time.monotonic() - began_s
        broken_ones = [text for text in water.broken if not any(text in known for known in lost)]
        lost += broken_ones
        packets = len(water.slots)
    sustained = (legs - 1 - first) * LEG_S / max(flown_s - away_s, 1e-9)
    lines = ["| fault | times | back after (median, worst) |", "|---|---|---|"]
    lines += [f"| {kind} | {len(s)} | {np.median(s):.1f} s, {max(s):.1f} s |" for kind, s in sorted(rows.items())]
    lines.append(
        f"{legs} legs ({legs * LEG_S / 3600.0:.1f} h, {options.method}) in {flown_s:.0f} s, {packets} packets; "
        f"{sustained:.1f} times real time between the faults (aim: {options.speed_up:g}); "
        + ("; ".join(lost) or "nothing lost: every step decided once")
    )
    worst = max((s for own in rows.values() for s in own if not math.isnan(s)), default=None)
    return Report(lines, tried=len(faults), survived=survived, worst_recovery_s=worst, lost=lost)
