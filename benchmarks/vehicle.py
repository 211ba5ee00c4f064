"""What one vehicle's computer needs: processor time and memory of its nodes in a paced mission, on one core.

Two vehicles fly apart, in real time, each in its own ROS domain with an emulated modem and a simulated autopilot
(`auv_lse sim --apart`). All processes of vehicle 1 (`auv_lse vehicle`) share one core; the simulator and vehicle 2 have
the others. A Raspberry Pi 4's core has about a third of the speed of a desktop's.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from auv_lse_run.process.domain import VEHICLE_DOMAINS, own_domain
from benchmarks.faults.kills import NODES, Program, give_go
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
    with tempfile.TemporaryDirectory() as parent, ExitStack() as kept:
        with own_domain() as simulators:  # let go here: the simulator takes it, and keeps it
            vehicles = [kept.enter_context(own_domain(VEHICLE_DOMAINS)) for _ in (1, 2)]
        return _fly(Path(parent), 4.0 if smoke else WINDOW_S, (simulators, *vehicles))


def _fly(folder: Path, window_s: float, domains: tuple[int, ...]) -> list[Row]:
    file = folder / "run" / "vehicles.yaml"
    steps = str(int((window_s + 120.0) / 15.7))
    team = ("--apart", "--vehicles", "2", "--steps", steps, "--seed", "5", "--no-report", "--out", str(file.parent))
    team += (f"--set=safety.state_copies={folder / 'state_copies'}",)  # else in the home, among those of real dives
    programs = [Program("sim", *team, "--domain", str(domains[0]))]
    cores = sorted(os.sched_getaffinity(0))
    try:
        _await(file.is_file, programs)
        for k in (2, 1):
            os.sched_setaffinity(0, set(cores[:1] if k == 1 else cores[1:] or cores))  # inherited
            own = (f"auv{k}", str(file), "--out", str(folder / f"auv{k}"))
            programs.append(Program("vehicle", *own, "--domain", str(domains[k])))
        os.sched_setaffinity(0, set(cores))
        _await(lambda: all(set(NODES) <= set(program.nodes) for program in programs[1:]), programs)
        for k in (2, 1):
            give_go(k, domains[k])
        time.sleep(1.0 if window_s < 10.0 else _START_S)
        return _measured(programs[-1], window_s)
    finally:
        os.sched_setaffinity(0, set(cores))
        for number in (signal.SIGINT, signal.SIGKILL):
            for program in reversed(programs):
                if program.process.poll() is None:
                    program.process.send_signal(number)
            for program in programs:
                try:
                    program.wait(40.0)
                except subprocess.TimeoutExpired:
                    continue


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


def _await(condition: Callable[[], bool], programs: list[Program], seconds: float = 120.0) -> None:
    until = time.monotonic() + seconds
    while not condition():
        ended = [program for program in programs if program.process.poll() is not None]
        if ended or time.monotonic() > until:
            raise RuntimeError(f"the mission did not begin: {''.join((ended or programs)[0].text)[-1000:]}")
        time.sleep(0.2)
