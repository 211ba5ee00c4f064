"""A soak of the nodes themselves: memory and processor time of each process of a paced mission under load.

A team's default nodes fly a mission over DDS, paced, with `SOUNDINGS_HZ` soundings a second of each vehicle, the most
that the simulated altimeter gives: at 2.5 times real time 50 a second by the wall. Vehicle 1 hears a transmitter that
babbles in its mates' names. Each process is looked at ten times.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from auv_lse_common.support.option_types import whole_from
from benchmarks.faults.kills import Program
from benchmarks.faults.report import Report
from benchmarks.faults.sockets import family_of

#: Soundings a second, and packets a second in the name of each mate, by the mission's clock.
SOUNDINGS_HZ = 20
PACKETS_HZ = 2
#: A process may grow by so much (MB) over the second half.
GROWTH_MB = 60.0
_LOOKS = 10
#: The nodes find one another in this time (s).
_START_S = 10.0
_NODE = re.compile(r"/(\w+_node)\b(?:.*__ns:=/(auv\d+))?")
_DOMAIN = re.compile(r"ROS_DOMAIN_ID=(\d+)")


@dataclass(frozen=True, slots=True)
class Look:
    """A sample of a process: private memory (MB), without pages shared with others, and processor time (s)."""

    memory_mb: float
    cpu_s: float


def _private_mb(pid: int) -> float:
    rollup = Path(f"/proc/{pid}/smaps_rollup").read_text()
    return sum(int(kb) for kb in re.findall(r"^Private_\w+:\s+(\d+) kB", rollup, re.MULTILINE)) / 1e3


def look(pid: int) -> dict[str, Look]:
    """The nodes among a process and its descendants, by name ("auv1.gp_node") (Linux)."""
    found = {}
    for member in family_of(pid):
        folder = Path(f"/proc/{member}")
        try:
            command = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            memory_mb = _private_mb(member)
        except OSError:
            continue  # it has ended
        match = _NODE.search(command)
        if match is None or "fork_server" in command:
            continue
        cpu_s = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        found[f"{match[2]}.{match[1]}" if match[2] else match[1]] = Look(memory_mb, cpu_s)
    return found


def soak(
    folder: Path, minutes: float, vehicles: int, factor: float, seed: int, say: Callable[[str], None]
) -> tuple[list[dict[str, Look]], float, int, int]:
    """Flies the mission; returns the looks, their distance (s), packets babbled, and the mission's exit code."""
    from benchmarks.faults.babbler_node import Babbler  # ROS: only this fault needs it

    steps = max(4, int((minutes * 60.0 + _START_S * factor) / 15.7) + 2)  # it lasts longer than the looks
    team = ("--vehicles", str(vehicles), "--steps", str(steps), "--seed", str(seed), "--out", str(folder))
    load = ("--set", "sim.altimeter.sounding_every_s=0", "--set", f"sim.dvl.rate_hz={SOUNDINGS_HZ}")
    program = Program("mission", *team, *load, "--real-time-factor", str(factor), "--no-report")
    looks: list[dict[str, Look]] = []
    try:
        domain = _domain_of(program)
        apart_s = minutes * 60.0 / factor / _LOOKS
        with Babbler(domain, min(4, vehicles - 1), seed) as babbler:
            while f"auv{vehicles}.planner_node" not in look(program.process.pid):
                time.sleep(0.2)
            time.sleep(_START_S)
            began = time.monotonic()
            while program.process.poll() is None and len(looks) < _LOOKS:
                now_s = (time.monotonic() - began) * factor
                babbler.babble(now_s)
                time.sleep(1.0 / PACKETS_HZ / factor)
                if time.monotonic() - began >= (len(looks) + 1) * apart_s:
                    looks.append(look(program.process.pid))
                    most = max(looks[-1].items(), key=lambda entry: entry[1].memory_mb, default=None)
                    if most is not None:
                        say(f"{now_s / 60.0:.1f} min: {len(looks[-1])} nodes, {most[0]} {most[1].memory_mb:.0f} MB")
            sent = babbler.sent
        program.wait(240.0)
    finally:
        if program.process.poll() is None:
            program.process.send_signal(signal.SIGINT)
            program.wait(60.0)
    return looks, apart_s, sent, program.process.returncode


def _domain_of(program: Program) -> int:
    until = time.monotonic() + 90.0
    while (match := _DOMAIN.search("".join(program.text))) is None:
        if time.monotonic() > until or program.process.poll() is not None:
            raise RuntimeError(f"the mission has not begun: {''.join(program.text)[-500:]}")
        time.sleep(0.2)
    return int(match[1])


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `auv_lse faults nodes`."""
    parser.add_argument("--minutes", type=float, default=30.0, metavar="N", help="mission time (default: %(default)s)")
    parser.add_argument(
        "--vehicles", type=whole_from(1), default=2, metavar="N", help="vehicles (default: %(default)s)"
    )
    parser.add_argument("--real-time-factor", type=float, default=2.5, metavar="X", help="speed (default: %(default)s)")


def run(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Report:
    """The table of a soak of nodes, and whether every process lived and stayed bounded."""
    minutes, vehicles, factor = options.minutes, options.vehicles, options.real_time_factor
    looks, apart_s, sent, code = soak(folder, minutes, vehicles, factor, options.seed, say)
    if len(looks) < _LOOKS:
        ended = f"the mission ended after {len(looks)} of {_LOOKS} looks, exit code {code}"
        return Report([ended], tried=1, survived=0, lost=[ended])
    names = sorted(looks[0], key=lambda name: (name.partition(".")[2] or name, name))
    first, middle, last = looks[0], looks[_LOOKS // 2 - 1], looks[-1]
    lines = [
        "| node | memory of its own at a tenth, half, end | processor time, share of a core |",
        "|---|---|---|",
    ]
    lost = [] if code == 0 else [f"the mission ended with exit code {code}"]
    for name in names:
        if name not in last or name not in middle:
            lines.append(f"| `{name}` | died | |")
            lost.append(f"{name} died")
            continue
        share = (last[name].cpu_s - first[name].cpu_s) / (apart_s * (_LOOKS - 1))
        sizes = ", ".join(f"{at[name].memory_mb:.0f}" for at in (first, middle, last))
        lines.append(f"| `{name}` | {sizes} MB | {100.0 * share:.1f} % |")
        if last[name].memory_mb - middle[name].memory_mb >= GROWTH_MB:
            lost.append(f"{name} grew")
    lines.append(
        f"{vehicles} vehicles, {minutes:g} min of the mission at {factor:g} times real time, {SOUNDINGS_HZ} soundings "
        f"a second, {sent} packets babbled; exit code {code}; a node may grow by {GROWTH_MB:g} MB over the second half"
    )
    return Report(lines, tried=1, survived=0 if lost else 1, lost=lost)
