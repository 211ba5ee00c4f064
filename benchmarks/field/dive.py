"""A whole field day of a simulated team, by `auv_lse fleet` alone: from check to certificate, with an abort in between.

The vehicles fly apart (`auv_lse sim --apart`), in real time: each has a computer with an sshd, nodes in a ROS domain of
its own, an emulated modem and a simulated autopilot. During the mission the laptop loses the last vehicle, and aborts:
the call reaches that vehicle by the acoustic packets of the others.
"""

import argparse
import contextlib
import io
import re
import secrets
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from auv_lse_common.node.state_memory import forget_copy
from auv_lse_run.command.main import main
from auv_lse_run.process.domain import VEHICLE_DOMAINS, own_domain
from auv_lse_shore.remote.chart import TeamChart
from auv_lse_shore.remote.fleet_file import read_fleet
from auv_lse_shore.remote.watching import Watch
from benchmarks.faults.kills import Program
from benchmarks.faults.report import Part
from benchmarks.field.relay import Relay
from benchmarks.field.sshd import Field, side_command

Say = Callable[[str], None]
#: Parameters of a short mission.
_SHORT = {"packet.tag": "true", "packet.session": "field", "tdma.slot_s": "7", "vehicle.start": "on_call"}
#: Legs of the vehicles, and of the simulator, which counts those before an abort, too, and must not end first.
_STEPS, _SIMULATED = 6, 60
_NODES_S, _MISSION_S = 120.0, 300.0
#: Events that the chart must have of each vehicle, and the longest time (s) between two of its positions.
_RATE = "bytes of excerpts, each vehicle and second"
_SHOWN, _GAP_S = ("pose", "plan", "map", "received"), 8.0


class _Chart(TeamChart):
    """The team's chart, which counts the bytes of excerpts, as they come over the link."""

    size = 0

    def take(self, name: str, answer: Mapping[str, Any]) -> bool:
        """Reads an excerpt."""
        self.size += len(answer.get("data", b""))
        return super().take(name, answer)

    def check(self, vehicles: int) -> str:
        """The first gap in the chart of a mission that has ended; "" if none."""
        events = self.timeline.since("", 0, sys.maxsize)[2]
        for k in range(1, vehicles + 1):
            of = {kind: [e["t"] for e in events if e["kind"] == kind and e.get("vehicle") == k] for kind in _SHOWN}
            if missing := [kind for kind, stamps in of.items() if not stamps]:
                return f"auv{k} has no {missing[0]} on the chart: {self.trouble or len(events)}"
            if (gap_s := max(b - a for a, b in pairwise(sorted(of["pose"])))) > _GAP_S:
                return f"auv{k} has no position on the chart for {gap_s:.0f} s"
        return ""


class DiveError(RuntimeError):
    """A step of the field day failed."""


@dataclass(slots=True)
class _Day:
    """A day: the fleet file, the links, and what each command printed."""

    file: Path
    relays: list[Relay]
    say: Say
    began_s: float

    def fleet(self, *words: str, code: int | None = 0) -> str:
        """Runs `auv_lse fleet`; returns its output.

        Raises:
            DiveError: if its exit code is not the one expected (None: any).
        """
        text = io.StringIO()
        with contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
            found = main(["fleet", str(self.file), *words])
        self.say(f"{time.monotonic() - self.began_s:4.0f} s  fleet {' '.join(words)}: exit code {found}")
        if code is not None and found != code:
            raise DiveError(f"fleet {' '.join(words)}: exit code {found}: {text.getvalue()[-1500:]}")
        return text.getvalue()

    def repeat(self, *commands: Sequence[str]) -> None:
        """Repeats commands until the exit codes are 0, as an operator does.

        Raises:
            DiveError: if they are not in time.
        """
        end_s = time.monotonic() + _NODES_S
        while True:
            try:
                for words in commands:
                    self.fleet(*words)
                return
            except DiveError:
                if time.monotonic() > end_s:
                    raise

    def await_states(self, wanted: str, of: int, within_s: float) -> None:
        """Waits until `watch` shows a state (a regular expression) of `of` vehicles.

        Raises:
            DiveError: if it does not in time.
        """
        end_s = time.monotonic() + within_s
        while len(re.findall(rf"(?m)^auv\d+ +({wanted})\b", text := self.fleet("watch", "--once", code=None))) < of:
            if time.monotonic() > end_s:
                raise DiveError(f"not {of} vehicles are {wanted} within {within_s:g} s: {text[-1500:]}")
            time.sleep(1.0)


def fly(folder: Path, vehicles: int, say: Say) -> dict[str, float]:
    """Flies the day; returns when each part was done, in seconds from its beginning, and `_RATE`.

    Args:
        folder: For everything that it leaves; must not exist.

    Raises:
        DiveError: naming the step that failed.
    """
    folder.mkdir(parents=True)
    with ExitStack() as found:  # let go at once: simulator and vehicles take them
        simulators = found.enter_context(own_domain())
        domains = [found.enter_context(own_domain(VEHICLE_DOMAINS)) for _ in range(vehicles)]
    with _simulator(folder, vehicles, simulators) as mission, _day(folder, domains, say) as day:
        try:
            return _flown(day, folder, mission, vehicles)
        finally:
            for relay in day.relays:
                relay.up = True
            day.fleet("stop", "--wait", "60", code=None)
            for path in folder.glob("field/auv*/dives/*/journal/*/*.state"):  # the vehicles may be under water
                forget_copy(path)


@contextlib.contextmanager
def _simulator(folder: Path, vehicles: int, domain: int) -> Iterator[Path]:
    """A context with a running simulator; the value is the vehicles' mission file."""
    key, run = folder / "team.key", folder / "run"
    key.write_text(secrets.token_hex(32))
    key.chmod(0o600)
    sets = [f"--set={name}={value}" for name, value in {**_SHORT, "packet.key_file": str(key)}.items()]
    team = ("--apart", "--vehicles", str(vehicles), "--steps", str(_SIMULATED), "--seed", "5", "--no-report")
    program = Program("sim", *team, "--out", str(run), "--domain", str(domain), *sets)
    try:
        mission = run / "vehicles.yaml"
        program.wait_until(mission.is_file, "the simulator does not run", _NODES_S)
        text, changed = re.subn(rf"\bsteps: {_SIMULATED}\b", f"steps: {_STEPS}", mission.read_text())
        assert changed == 1
        mission.write_text(text)
        yield mission
    finally:
        program.end()


@contextlib.contextmanager
def _day(folder: Path, domains: list[int], say: Say) -> Iterator[_Day]:
    """A context with the vehicles' computers, each behind a relay."""
    field = Field(folder / "field")
    command = f"XDG_STATE_HOME={folder}/state {side_command()}"  # its own second copies of the mission's state
    with ExitStack() as stack:
        relays, entries = [], {}
        for k, domain in enumerate(domains, 1):
            computer = stack.enter_context(field.computer(f"auv{k}"))
            relay = stack.enter_context(Relay(computer.port, k))
            field.trust(f"auv{k}", relay.port)
            relays.append(relay)
            at = {"port": relay.port, "folder": str(computer.folder), "domain": domain}
            entries[f"auv{k}"] = {**at, "command": command}
        yield _Day(field.fleet_file(entries), relays, say, time.monotonic())


def _flown(day: _Day, folder: Path, mission: Path, vehicles: int) -> dict[str, float]:
    done: dict[str, float] = {}

    def note(part: str) -> None:
        done[part] = time.monotonic() - day.began_s

    day.fleet("check", "--quick", code=1)  # there is no mission yet
    day.fleet("send", str(mission))
    day.fleet("start", "--wait", "60")
    day.await_states("WAITING|HOLDING", vehicles, _NODES_S)
    fleet = read_fleet(day.file)
    chart = _Chart("day", range(1, vehicles + 1))
    with chart, Watch(fleet, fleet.vehicles, 2.0, chart):
        day.repeat(("check",))  # on a busy computer the first position may be late
        day.fleet("go")
        note("under way")
        day.await_states("RUNNING", vehicles, _NODES_S)
        _aborted(day, folder, vehicles)
        note("aborted")
        day.repeat(("reset",), ("go", "--anyway"))  # a call that was in the water at the RESET aborts some again
        day.await_states("ENDED", vehicles, _MISSION_S)
        note("ended")
        end_s = time.monotonic() + 60.0
        while (lack := chart.check(vehicles)) and time.monotonic() < end_s:
            time.sleep(1.0)
        if lack:
            raise DiveError(lack)
        done[_RATE] = chart.size / vehicles / (done["ended"] - done["under way"])
    day.fleet("stop", "--wait", "60")
    day.fleet("fetch", "--out", str(folder / "out"))
    note("certificate")
    for name in ("adjusted/report.html", "certificate"):
        if not (folder / "out" / name).exists():
            raise DiveError(f"fetch has not made {name}")
    return done


def _aborted(day: _Day, folder: Path, vehicles: int) -> None:
    """Aborts the team while the last vehicle is out of reach; it hears that from a mate."""
    lost, relay = f"auv{vehicles}", day.relays[-1]
    relay.up = False
    relay.cut_all()
    text = day.fleet("abort", "--wait", "1", code=1)
    if f"{lost}: ABORT is pending" not in text or text.count("ABORT acted") != vehicles - 1:
        raise DiveError(f"abort with {lost} out of reach: {text}")
    end_s = time.monotonic() + _MISSION_S
    while not any("ABORTED" in log.read_text() for log in folder.glob(f"field/{lost}/dives/*/logs/*safety_node.log")):
        if time.monotonic() > end_s:
            raise DiveError(f"{lost} has not heard its mates' abort within {_MISSION_S:g} s")
        time.sleep(1.0)
    relay.up = True
    day.fleet("pending", "--wait", "60")
    day.await_states("ABORTED", vehicles, 60.0)


def part(options: argparse.Namespace, folder: Path, say: Say) -> Part:
    """The day as a row of the table of `auv_lse faults field`."""
    began_s = time.monotonic()
    try:
        done, wrong = fly(folder, options.dive, say), list[str]()
    except RuntimeError as error:
        done, wrong = {}, [str(error)]
    rate = done.pop(_RATE, 0.0)
    figures = ", ".join(f"{name} after {at_s:.0f} s" for name, at_s in done.items())
    figures += f"; the chart takes {rate:.0f} B/s of each vehicle" if rate else ""
    name = f"a day of {options.dive} vehicles, from check to certificate, {time.monotonic() - began_s:.0f} s"
    return name, 1, int(not wrong), figures, wrong
