"""Kills nodes of vehicles under way, and reads the effects from their recordings.

The vehicles share nothing but the simulated water (`auv_lse sim --apart`). Nodes, Micromodem driver and autopilot link
run as on real vehicles, in real time. The recorders are not killed, because their recordings are the evidence.
"""

import argparse
import contextlib
import math
import os
import re
import secrets
import signal
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.node.state_memory import forget_copy
from auv_lse_common.support.confinement import NETWORK_VARIABLES
from auv_lse_common.support.option_types import whole_from
from auv_lse_common.vocabulary.stamps import seconds
from auv_lse_record.recording import Recording, recording_in
from auv_lse_run.process.domain import VEHICLE_DOMAINS, own_domain
from auv_lse_run.process.processes import last_lines
from benchmarks.faults.report import Report
from benchmarks.faults.sockets import OpenSocket, family_of, open_sockets

SMALL = ("--kills", "25")
#: A killed node has to be ready again within this time (s).
BACK_S = 5.0
#: How long a leg takes (s), and how often that long it may take at most.
LEG_S, LONGEST = 15.7, 2.0
#: The nodes that are killed.
NODES = ("gp_node", "planner_node", "safety_node", "modem_node", "micromodem_node", "vehicle_link_node")
_AT_WORK = re.compile(r"\[INFO\] \[(\d+\.\d+)\] .*: ready after \d+\.\d+ s of processor time$", re.MULTILINE)
_STARTED = re.compile(r"auv(\d+)\.(\w+) (?:re)?started.*, process (\d+)")
_ROOT = Path(__file__).resolve().parents[2]


@dataclass(slots=True)
class Kill:
    """A node that was killed.

    Attributes:
        when_s: When (s since 1970).
        back_s: Time (s) until it was ready again; NaN if it never was.
        lost: State that it lost, or "".
    """

    vehicle: int
    node: str
    when_s: float
    back_s: float = math.nan
    lost: str = ""


@dataclass(slots=True)
class Flight:
    """The results of a mission with kills.

    Attributes:
        steps: Steps that each vehicle decided, in their order, by vehicle.
        legs_s: Times (s) from one of its decisions to the next, by vehicle.
        heard: Mates' plans that each vehicle received, by vehicle.
        outputs: What each process printed, the simulator's first.
        codes: Their exit codes.
        recordings: The recordings, by vehicle.
        sockets: What simulator and vehicles had open before the first kill.
    """

    kills: list[Kill] = field(default_factory=list)
    steps: dict[int, list[int]] = field(default_factory=dict)
    legs_s: dict[int, list[float]] = field(default_factory=dict)
    heard: dict[int, int] = field(default_factory=dict)
    outputs: list[str] = field(default_factory=list)
    codes: list[int] = field(default_factory=list)
    recordings: dict[int, Path] = field(default_factory=dict)
    sockets: list[OpenSocket] = field(default_factory=list)


class Program:
    """A process whose output is read while it runs.

    Attributes:
        text: Its output, by line.
        nodes: Process id of each node that it reported to have started.
    """

    def __init__(self, verb: str, *arguments: str) -> None:
        self.text: list[str] = []
        self.nodes: dict[str, int] = {}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "auv_lse_run", verb, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**{k: v for k, v in os.environ.items() if k not in NETWORK_VARIABLES}, "AUV_LSE_ROOT": str(_ROOT)},
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.text.append(line)
            if match := _STARTED.search(line):
                self.nodes[match[2]] = int(match[3])

    def has_all_nodes(self) -> bool:
        """Whether it has reported the start of all `NODES`."""
        return set(NODES) <= set(self.nodes)

    def runs(self, node: str) -> bool:
        """Whether the process that it started last for a node still runs."""
        return Path(f"/proc/{self.nodes[node]}").exists()

    def wait_until(self, condition: Callable[[], object], what: str, seconds: float = 120.0) -> None:
        """Waits until `condition` holds.

        Raises:
            RuntimeError: with `what` and its last output, if it ends instead, or takes longer than `seconds`.
        """
        until_s = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > until_s or self.process.poll() is not None:
                raise RuntimeError(f"{what}: {''.join(self.text)[-2000:]}")
            time.sleep(0.05)

    def end(self) -> None:
        """Ends it if it still runs: in an orderly way, after 40 s by force."""
        for number in (signal.SIGINT, signal.SIGKILL):
            if self.process.poll() is None:
                self.process.send_signal(number)
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self.wait(40.0)

    def wait(self, seconds: float) -> None:
        """Waits for its end; raises subprocess.TimeoutExpired if it still runs after `seconds`."""
        self.process.wait(seconds)
        self._reader.join(10.0)


def give_go(vehicle: int, domain: int) -> None:
    """Starts the mission of a vehicle, which waits for GO because it has an autopilot.

    Raises:
        RuntimeError: if it does not accept that.
    """
    go = Program("go", f"auv{vehicle}", "--domain", str(domain))
    go.wait(60.0)
    if go.process.returncode:
        raise RuntimeError(f"GO was not accepted: {''.join(go.text)[-1000:]}")


@contextmanager
def vehicles_apart(
    folder: Path, steps: int, *arguments: str, before: Callable[[int], None] = lambda vehicle: None
) -> Iterator[list[Program]]:
    """Two vehicles under way: the simulator, vehicle 1 and vehicle 2, each in a ROS domain of its own.

    They are ended with the context; what each printed is in `folder`.

    Args:
        folder: The output folder; must not exist.
        arguments: Further ones of `auv_lse sim`.
        before: Called with each vehicle's number before it is started.

    Raises:
        RuntimeError: if they do not get under way.
    """
    with ExitStack() as kept:
        with own_domain() as simulators:  # let go here: the simulator takes it, and keeps it
            # kept from other missions on this machine
            domains = (simulators, *[kept.enter_context(own_domain(VEHICLE_DOMAINS)) for _ in (1, 2)])
        folder.mkdir(parents=True)
        file = folder / "run" / "vehicles.yaml"
        # second copies of its own: those of an earlier flight that was killed would make these vehicles wait for RESET
        copies = f"--set=safety.state_copies={folder / 'state_copies'}"
        team = ("--apart", "--vehicles", "2", "--steps", str(steps), "--seed", "5", "--out", str(file.parent), copies)
        programs = [Program("sim", *team, *arguments, "--domain", str(domains[0]))]
        try:
            programs[0].wait_until(file.is_file, "the simulator has not written vehicles.yaml")
            for k in (1, 2):
                before(k)
                own = (f"auv{k}", str(file), "--out", str(folder / f"auv{k}"))
                programs.append(Program("vehicle", *own, "--domain", str(domains[k])))
            for k in (1, 2):
                programs[k].wait_until(programs[k].has_all_nodes, f"auv{k}'s nodes did not start", 300.0)
            for k in (1, 2):
                give_go(k, domains[k])
            yield programs
        finally:
            for program in programs:
                program.end()
            for path in folder.glob("auv*/journal/*/*.state"):  # their vehicles may have been under water
                forget_copy(path)
            for program, name in zip(programs, ("simulator", "auv1", "auv2"), strict=False):
                (folder / f"{name}.output").write_text("".join(program.text))


def fly(
    folder: Path,
    steps: int,
    kills: Callable[[float], Sequence[tuple[float, int, str]]],
    more: Mapping[str, str],
    say: Callable[[str], None] = lambda text: None,
) -> Flight:
    """Flies a mission of two vehicles and kills nodes.

    Args:
        folder: The output folder; must not exist.
        kills: From the time of travel (s), the kills: time after the vehicles are under way (s), vehicle, node.

    Raises:
        RuntimeError: if the simulator does not run, or nodes do not start.
        TimeoutError: if the mission does not end.
    """
    flight = Flight()
    with vehicles_apart(folder, steps, *(f"--set={name}={value}" for name, value in more.items())) as programs:
        simulator, *vehicles = programs
        under_way_s = time.time() + 10.0
        for after_s, vehicle, node in kills(steps * LEG_S):
            time.sleep(max(0.0, under_way_s + after_s - time.time()))
            if not flight.kills:
                flight.sockets = open_sockets(pid for p in programs for pid in family_of(p.process.pid))
            if simulator.process.poll() is not None:
                if flight.kills:
                    break
                simulator.wait(10.0)
                raise RuntimeError(f"the simulator has ended before the first kill: {''.join(simulator.text)}")
            program = programs[vehicle]
            # killed a moment ago: as soon as it is started again
            program.wait_until(partial(program.runs, node), f"auv{vehicle} {node} was not started again", 60.0)
            kill = Kill(vehicle, node, time.time())
            os.kill(program.nodes[node], signal.SIGKILL)
            flight.kills.append(kill)
            say(f"kill {len(flight.kills)}: auv{vehicle} {node}")
        _await_end(simulator.process, folder, steps * 60.0 + 200.0)
        for program in vehicles:
            program.process.send_signal(signal.SIGTERM)
        for program in vehicles:
            program.wait(40.0)
    flight.outputs = ["".join(program.text) for program in programs]
    flight.codes = [program.process.returncode for program in programs]
    for k in (1, 2):
        flight.recordings[k] = recording_in(folder / f"auv{k}")
        _read(flight, k, folder / f"auv{k}" / "logs")
    return flight


def _await_end(simulator: subprocess.Popen[str], folder: Path, seconds: float) -> None:
    """Waits until the simulator ends. It may not see that a vehicle has ended whose link was killed: then ends it."""
    logs = [folder / f"auv{k}" / "logs" / f"auv{k}.safety_node.log" for k in (1, 2)]
    until, ended_s = time.monotonic() + seconds, math.inf
    while simulator.poll() is None:
        if time.monotonic() > until:
            stand = "; ".join(f"{log.stem}: {last_lines(log, 1)}" for log in logs)
            raise TimeoutError(f"the mission has not ended within {seconds:.0f} s: {stand}")
        if math.isinf(ended_s) and all("mission ENDED" in log.read_text() for log in logs):
            ended_s = time.monotonic()
        if time.monotonic() > ended_s + 8.0:
            simulator.send_signal(signal.SIGINT)
            simulator.wait(60.0)
            simulator.returncode = 0
        time.sleep(0.5)


def _read(flight: Flight, vehicle: int, logs: Path) -> None:
    """Reads each node's restarts and losses from a recording and the nodes' logs."""
    topics = {"gp_node": f"/auv{vehicle}/kernel_centers", "modem_node": f"/auv{vehicle}/tdma"}
    seen: dict[str, list[tuple[float, Any]]] = {node: [] for node in NODES}
    steps, decided_s, heard = [], [], 0
    wanted = [*topics.values(), f"/auv{vehicle}/planner/bound", f"/auv{vehicle}/team/plans"]
    with Recording(flight.recordings[vehicle]) as recording:
        for topic, stamp_ns, message in recording.messages(wanted):
            if topic.endswith("/bound"):
                steps.append(int(message.step))
                decided_s.append(seconds(message.header.stamp))
            elif topic.endswith("/plans"):
                heard += 1
            for node, name in topics.items():
                if topic == name:
                    seen[node].append((stamp_ns * 1e-9, message))
    flight.steps[vehicle], flight.heard[vehicle] = steps, heard
    flight.legs_s[vehicle] = [after - before for before, after in pairwise(decided_s)]
    at_work = {
        node: [float(s) for s in _AT_WORK.findall((logs / f"auv{vehicle}.{node}.log").read_text())] for node in NODES
    }
    for kill in flight.kills:
        if kill.vehicle == vehicle:
            kill.back_s = min((s - kill.when_s for s in at_work[kill.node] if s > kill.when_s), default=math.nan)
            before = [m for t, m in seen[kill.node] if t < kill.when_s]
            # what a dying process had still sent arrives within 0.2 s
            after = [m for t, m in seen[kill.node] if t > kill.when_s + 0.2]
            kill.lost = _lost(kill.node, before, after[0]) if before and after else ""


def _lost(node: str, before: Sequence[Any], after: Any) -> str:
    if node == "gp_node" and len(after.depth_m) < len(before[-1].depth_m):
        return f"{len(after.depth_m)} centers of {len(before[-1].depth_m)}"
    # a packet whose confirmation came while the node was away counts as not sent: its samples go into a later one
    if node == "modem_node" and after.slots_used < before[-1].slots_used - 1:
        return f"{after.slots_used} slots used of {before[-1].slots_used}"
    return ""


def at_random(number: int, seed: int) -> Callable[[float], list[tuple[float, int, str]]]:
    """Draws kills of random nodes at random times of a mission."""

    def of(travel_s: float) -> list[tuple[float, int, str]]:
        rng = np.random.default_rng(seed)
        times_s = np.sort(rng.uniform(0.0, travel_s - 20.0, number))
        nodes = sorted(NODES)
        return [(float(t), int(rng.integers(1, 3)), nodes[int(rng.integers(len(nodes)))]) for t in times_s]

    return of


def table(flight: Flight, steps: int) -> Report:
    """The table of a flight's kills, one row per node, and its decided steps."""
    lines = ["| node | kills | back after (median, worst) | lost |", "|---|---|---|---|"]
    lost = [f"a program ended with exit code {code}" for code in flight.codes if code != 0]
    for node in NODES:
        mine = [kill for kill in flight.kills if kill.node == node]
        back = [kill.back_s for kill in mine if not math.isnan(kill.back_s)]
        lost_here = [kill.lost for kill in mine if kill.lost] + ["never back"] * (len(mine) - len(back))
        if back:
            times = f"{statistics.median(back):.1f} s, {max(back):.1f} s"
            lines.append(f"| `{node}` | {len(mine)} | {times} | {'; '.join(lost_here) or 'nothing'} |")
        lost += [f"{node}: {what}" for what in lost_here]
    for vehicle, decided in flight.steps.items():
        whole = decided == list(range(steps))
        lines.append(
            f"auv{vehicle}: steps decided: {f'0 to {steps - 1}, each once' if whole else decided}; "
            f"{flight.heard[vehicle]} plans heard"
        )
        legs_s = flight.legs_s[vehicle]
        lines[-1] += f"; from decision to decision {min(legs_s):.0f} to {max(legs_s):.0f} s" if legs_s else ""
        lost += [] if whole else [f"auv{vehicle}: not every step decided once"]
        if max(legs_s, default=0.0) > LONGEST * LEG_S:
            lost.append(f"auv{vehicle}: {max(legs_s):.0f} s from one decision to the next")
    back = [kill.back_s for kill in flight.kills]
    survived = sum(s <= BACK_S for s in back)
    return Report(lines, len(back), survived, max((s for s in back if not math.isnan(s)), default=None), lost)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `auv_lse faults kills`."""
    parser.add_argument(
        "--kills", type=whole_from(1), default=50, metavar="N", help="how many (default: %(default)s; 9 s each)"
    )


def run(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Report:
    """Flies a mission with authenticated packets, and kills `--kills` nodes."""
    folder.mkdir(parents=True)
    key = folder / "key"
    key.touch(0o600)
    key.write_text(secrets.token_hex(32))
    steps = max(4, int(options.kills * 9.0 / LEG_S) + 3)
    more = {"record.map_bytes_per_s": "0", "packet.tag": "true", "packet.key_file": str(key), "packet.session": "kills"}
    flight = fly(folder / "flight", steps, at_random(options.kills, options.seed), more, say)
    return table(flight, steps)
