"""Intruders in the ROS domain of a simulation: they must be named, and must not change it.

They reserve nothing, as a vehicle in a container or nodes that were started by hand, and join the domain as soon as it
is known. The simulation's summary must be that of the same mission alone. `test_domain.py` has what is refused.
"""

import argparse
import contextlib
import json
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import yaml

from auv_lse_common.node.dive import DIVE_VARIABLE, new_dive
from auv_lse_common.support.project_folder import project_folder
from auv_lse_common.vocabulary.vehicle_nodes import vehicle_nodes
from auv_lse_record.recording import recording_in
from auv_lse_run.process.domain import node_environment
from auv_lse_run.process.keeper import ProcessKeeper, node_task
from auv_lse_run.process.processes import Process
from benchmarks.faults.kills import Program
from benchmarks.faults.report import Report

#: Arguments of `auv_lse faults all`.
SMALL: Sequence[str] = ()
_DOMAIN = re.compile(r"ROS_DOMAIN_ID=(\d+)|ROS domain (\d+)")
_NAMED = "publishes in this ROS domain, too"
_MISSION = ("--vehicles", "2", "--steps", "20", "--seed", "5", "--no-report")
_TIMES = ("planning_median_s", "planning_max_s", "wall_s")
_START_S = 120.0


@dataclass(frozen=True, slots=True)
class Pair:
    """Outcome of a simulation with an intruder: a description, what is wrong, when the intruder was named (s)."""

    name: str
    what: str
    wrong: str = ""
    named_s: float | None = None


def _domain(program: Program) -> int:
    program.wait_until(lambda: _DOMAIN.search("".join(program.text)), "no ROS domain is printed")
    match = _DOMAIN.search("".join(program.text))
    assert match is not None
    return int(match[1] or match[2])


def _mission(out: Path, *more: str) -> Program:
    return Program("mission", *_MISSION, *more, "--out", str(out))


def _summary(run: Path) -> dict[str, object]:
    values: dict[str, object] = json.loads((run / "summary.json").read_text())
    return {name: value for name, value in values.items() if name not in _TIMES}


def _vehicle_file(path: Path, out: Path) -> Path:
    """The mission file of a vehicle that starts at once and has no mates."""
    body = yaml.safe_load((out / "mission.yaml").read_text())
    own = body["/**"]["ros__parameters"]
    del own["sim"]
    own.setdefault("record", {})["folder"] = ""
    own.setdefault("safety", {})["state_copies"] = str(path.parent / "state_copies")
    path.write_text(yaml.safe_dump(body))
    return path


@contextlib.contextmanager
def _stray_nodes(domain: int, dive: str, file: Path, logs: Path) -> Iterator[None]:
    """The nodes of a vehicle that have reserved nothing, as in a container, or started by hand."""
    logs.mkdir(parents=True)
    nodes = [
        Process(package=package, executable=name, namespace="/auv1") for package, name in vehicle_nodes(False, False)
    ]
    environment = node_environment(domain) | {DIVE_VARIABLE: dive}
    keeper = ProcessKeeper([node_task(node, file) for node in nodes], logs, environment, lambda text: None)
    stop = threading.Event()

    def keep() -> None:
        while not stop.wait(0.2):
            keeper.tick(time.monotonic())

    thread = threading.Thread(target=keep)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()
        keeper.stop()


@contextlib.contextmanager
def _stray_recording(domain: int, run: Path) -> Iterator[None]:
    """`ros2 bag play` of another mission's recording, its commands included, again and again."""
    command = [sys.executable, "-m", "benchmarks.faults.stray_player_node", str(recording_in(run))]
    player = subprocess.Popen(command, env=node_environment(domain), cwd=project_folder())
    try:
        yield
    finally:
        player.terminate()
        player.wait(20.0)


def intruded(name: str, folder: Path, alone: Path, intruder: Callable[[int], AbstractContextManager[None]]) -> Pair:
    """A simulation into whose domain an intruder comes that has reserved nothing."""
    mission = _mission(folder / "run")
    try:
        with intruder(_domain(mission)):
            began_s, named_s = time.monotonic(), None
            while mission.process.poll() is None and time.monotonic() - began_s < _START_S:
                if named_s is None and any(_NAMED in line for line in mission.text):
                    named_s = time.monotonic() - began_s
                time.sleep(0.05)
        with contextlib.suppress(subprocess.TimeoutExpired):
            mission.wait(60.0)
        has_ended = mission.process.poll() is not None
    finally:
        mission.end()
    wrong = []
    if not has_ended:
        wrong.append("the mission has not ended")
    elif mission.process.returncode != 0:
        wrong.append(f"exit code {mission.process.returncode}: {''.join(mission.text)[-1000:]}")
    elif changed := _changed(_summary(folder / "run"), _summary(alone)):
        wrong.append(f"changed: {', '.join(changed)}")
    if named_s is None:
        wrong.append("the intruder was not named")
    named = next((line.strip() for line in mission.text if _NAMED in line), "")
    return Pair(name, f"the same mission as alone; {named[:100]}" if not wrong else "", "; ".join(wrong), named_s)


def _changed(one: dict[str, object], other: dict[str, object]) -> list[str]:
    return sorted(key for key in one.keys() | other.keys() if one.get(key) != other.get(key))


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds no option."""


def run(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Report:
    """Tries every intruder."""
    folder.mkdir(parents=True)
    alone, other = folder / "alone", folder / "other"
    for out, seed in ((alone, "5"), (other, "6")):
        mission = _mission(out, "--seed", seed)
        mission.wait(_START_S)
        if mission.process.returncode:
            raise RuntimeError("".join(mission.text))
    file = _vehicle_file(folder / "stray.yaml", other)
    intruders: dict[str, Callable[[int], AbstractContextManager[None]]] = {
        "nodes started by hand in a simulation": lambda domain: _stray_nodes(domain, "", file, folder / "by hand"),
        "a vehicle in a simulation": lambda domain: _stray_nodes(domain, new_dive("auv1"), file, folder / "vehicle"),
        "a recording played into a simulation": lambda domain: _stray_recording(domain, other),
    }
    pairs = []
    for number, (name, intruder) in enumerate(intruders.items()):
        pairs.append(intruded(name, folder / f"intruded {number}", alone, intruder))
        say(f"{name}: {pairs[-1].wrong or 'good'}")
    lines = ["| intruder | what happened |", "|---|---|", *(f"| {p.name} | {p.wrong or p.what} |" for p in pairs)]
    named_s = [p.named_s for p in pairs if p.named_s is not None]
    wrong = [f"{p.name}: {p.wrong}" for p in pairs if p.wrong]
    return Report(lines, len(pairs), len(pairs) - len(wrong), max(named_s, default=None), wrong)
