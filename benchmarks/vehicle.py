"""Load of one vehicle's computer: processor time and memory of its nodes in a paced mission, on one core.

Two vehicles fly apart, in real time, each in its own ROS domain with an emulated modem and a simulated autopilot
(`auv_lse sim --apart`). All processes of vehicle 1 (`auv_lse vehicle`) share one core; the simulator and vehicle 2 have
the others. A Raspberry Pi 4's core has about a third of the speed of a desktop's.
"""

import os
import re
import tempfile
import time
from collections import defaultdict
from pathlib import Path

from benchmarks.faults.kills import Program, vehicles_apart
from benchmarks.faults.sockets import family_of
from benchmarks.rows import Row, row

#: Share of one core, and memory (MB), of all processes of one vehicle.
GOAL_SHARE, GOAL_MB = 0.35, 400.0
#: Mission time measured (s); its first decisions come before.
WINDOW_S = 240.0
_START_S, _LOOK_S = 20.0, 10.0
_MAPPING = re.compile(r"^[0-9a-f]+-[0-9a-f]+ \S+ ([0-9a-f]+) \S+ \d+ *(.*)$")


def cpu_s(pid: int) -> float:
    """Processor time (s) of a process so far; 0 if it has ended."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def memory_mb(pids: list[int]) -> tuple[float, dict[int, float]]:
    """Memory of processes (MB): together, and the proportional share (PSS) of each.

    Together, a page of a file counts once, also if programs outside of `pids` have it, too: they do not run on a
    vehicle. Other pages count by their share, as they are shared among `pids` alone.
    """
    files: dict[tuple[str, str], float] = defaultdict(float)
    others_kb, shares = 0.0, {}
    for pid in pids:
        try:
            text = Path(f"/proc/{pid}/smaps").read_text()
        except OSError:
            continue  # it has ended
        position, size, shares[pid] = ("", ""), {"Rss": 0.0, "Pss": 0.0, "Anonymous": 0.0}, 0.0
        for line in [*text.splitlines(), "0-0 - 0 - 0"]:
            if match := _MAPPING.match(line):
                of_file = max(0.0, size["Rss"] - size["Anonymous"]) if position[0].startswith("/") else 0.0
                files[position] = max(files[position], of_file)
                others_kb += min(size["Pss"], size["Anonymous"]) if position[0].startswith("/") else size["Pss"]
                shares[pid] += size["Pss"] / 1e3
                position, size = (match[2], match[1]), dict.fromkeys(size, 0.0)
            else:
                name, _, value = line.partition(":")
                if name in size:
                    size[name] = float(value.split()[0])
    return (others_kb + sum(files.values())) / 1e3, shares


def run(*, smoke: bool = False) -> list[Row]:
    """Flies the mission and looks at vehicle 1's processes.

    Raises:
        RuntimeError: if the mission did not fly.
    """
    cores, window_s = sorted(os.sched_getaffinity(0)), 4.0 if smoke else WINDOW_S

    def use_core(vehicle: int) -> None:
        os.sched_setaffinity(0, set(cores[:1] if vehicle == 1 else cores[1:] or cores))  # inherited

    with tempfile.TemporaryDirectory() as parent:
        folder, steps = Path(parent) / "flight", int((window_s + 120.0) / 15.7)
        try:
            with vehicles_apart(folder, steps, "--no-report", before=use_core) as programs:
                time.sleep(1.0 if smoke else _START_S)
                return _measured(programs[1], window_s)
        finally:
            os.sched_setaffinity(0, set(cores))


def _measured(vehicle: Program, window_s: float) -> list[Row]:
    names = {pid: name for name, pid in vehicle.nodes.items()}
    before, began_s = {pid: cpu_s(pid) for pid in family_of(vehicle.process.pid)}, time.monotonic()
    most_mb, shares_mb = 0.0, dict[int, float]()
    while time.monotonic() < began_s + window_s:
        time.sleep(min(_LOOK_S, window_s))
        if vehicle.process.poll() is not None:
            raise RuntimeError(f"the vehicle has ended: {''.join(vehicle.text)[-1000:]}")
        alone_mb, shares = memory_mb(family_of(vehicle.process.pid))
        if sum(shares.values()) > sum(shares_mb.values()):
            most_mb, shares_mb = alone_mb, shares
    passed_s = time.monotonic() - began_s
    used = {pid: (cpu_s(pid) - before.get(pid, 0.0)) / passed_s for pid in family_of(vehicle.process.pid)}
    total, memory = sum(used.values()), sum(shares_mb.values())
    rows = [
        row("vehicle: processor", 100 * total, "% of a core", goal=f"< {GOAL_SHARE:.0%}", holds=total < GOAL_SHARE),
        row("vehicle: memory (PSS)", memory, "MB", goal=f"< {GOAL_MB:.0f} MB", holds=memory < GOAL_MB),
        row("vehicle: memory, files' pages in full", most_mb, "MB"),
    ]
    for pid in sorted(used, key=lambda pid: -used[pid]):
        name = names.get(pid, "supervisor" if pid == vehicle.process.pid else "fork server")
        rows.append(row(f"vehicle: {name}, processor", 100 * used[pid], "% of a core"))
        rows.append(row(f"vehicle: {name}, share of the memory (PSS)", shares_mb.get(pid, 0.0), "MB"))
    return rows
