"""A working day of a team: each vehicle has kills of its nodes and power losses at its own steps; nothing may be lost.

The nodes are real, and the water moves the vehicles faster than real time. The nodes' clock is that of the wall, so
slots, health and a decision's lead are not shortened; positions are corrected as often as in a mission at real speed.
The speed-up that the machine sustains is measured. No check depends on it: a vehicle waits at a leg's end for the next.

Dead-reckoned positions are exact and terrain is not matched, so corrections move no sounding, and a map's centers can
be looked for in later maps.
"""

import argparse
import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.positions import PositionsConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.support.option_types import positive, whole_from
from auv_lse_common.vocabulary.mission_run import RunState
from auv_lse_shore.mission_options import check_option
from benchmarks.faults.bed.dive_bed import NODES, DiveBed, Vehicle, dive_bed
from benchmarks.faults.bed.ledger import journal_problem, lost_positions
from benchmarks.faults.kills import LEG_S
from benchmarks.faults.report import Report
from benchmarks.vehicle import memory_mb

#: Speed (m/s) at which a leg takes `LEG_S`.
SPEED_MPS = 1.5
#: The water moves vehicles this much faster than the aim: they wait during recoveries, which count.
CATCH_UP = 1.15
#: A vehicle that has decided nothing, or is not back, after this time (s) has failed.
NEVER_S = 300.0
#: The last kills of each vehicle, which show restarts after the day, and the legs between two of them in the team.
LATE = ("gp_node", "planner_node")
LATE_APART = 6
#: After a rebuild soundings are merged in another order. A center is then less than this many spacings away: one to its
#: first sounding, one to the first sounding of the center into which that is merged, one to that center.
SPACINGS = 3.0
#: Goal for the restart of a node after the day (s), and maximum memory of a vehicle (MB).
RESTART_S, MEMORY_MB = 5.0, 500.0
#: First topic of a restarted node that every reader receives; a restarted modem_node has to wait for a slot.
OUTPUTS = {"gp_node": "kernel_centers", "safety_node": "mission/state", "planner_node": "waypoint"}


@dataclass(frozen=True, slots=True)
class Fault:
    """A kill after a step: of a node, or "" for a power loss; `late`: at the end of the day."""

    step: int
    node: str
    late: bool = False

    @property
    def name(self) -> str:
        """The fault's name in the table."""
        return f"`{self.node}`" if self.node else "power loss"


def least_legs(vehicles: int, kills: int, reboots: int) -> int:
    """The fewest legs of a mission in which each fault of the team has a step of its own."""
    return vehicles * (kills + reboots) + vehicles * len(LATE) * LATE_APART + 4


def schedule(vehicles: int, legs: int, kills: int, reboots: int, rng: np.random.Generator) -> dict[int, list[Fault]]:
    """The faults of each vehicle, in order of their steps.

    All faults of the team have different steps, and the vehicles take turns. A node is not killed twice in a row,
    because the keeper delays repeated restarts. The last kills are those of `LATE`, near the mission's end.
    """
    late = LATE[len(LATE) - min(kills, len(LATE)) :]
    early = kills - len(late) + reboots
    begin = legs - 2 - vehicles * len(late) * LATE_APART
    steps = np.sort(rng.choice(np.arange(1, begin), vehicles * early, replace=False)).tolist()
    faults: dict[int, list[Fault]] = {}
    for k in range(vehicles):
        lost_power = set(rng.choice(early, reboots, replace=False).tolist())
        faults[k + 1] = own = []
        node = ""
        for number, step in enumerate(steps[k::vehicles]):
            is_last = number == early - 1  # the next one is the first of `late`
            others = [other for other in NODES if other != node and not (is_last and other in late[:1])]
            node = "" if number in lost_power else str(rng.choice(others))
            own.append(Fault(step, node))
        own += [Fault(begin + (i * vehicles + k) * LATE_APART, node, late=True) for i, node in enumerate(late)]
    return faults


@dataclass(slots=True)
class Strike:
    """A fault and the recovery from it; times (s) after the death of the processes, NaN until then.

    Attributes:
        output_s: The first output of the node, or of the last node to publish one.
        decided_s: The next decision; infinite if the mission has ended by then.
        heard_s: The vehicle hears all mates, and they hear it; infinite without mates.
        wrong: What was lost, or never came back.
    """

    vehicle: int
    fault: Fault
    step: int
    output_s: float = math.nan
    decided_s: float = math.nan
    heard_s: float = math.nan
    wrong: list[str] = field(default_factory=list)

    def missing(self) -> str:
        """Outputs that have not come back; "" if all have."""
        parts = {"an output of each node": self.output_s, "a decision": self.decided_s, "mates' packets": self.heard_s}
        return ", ".join(name for name, value in parts.items() if math.isnan(value))

    @property
    def text(self) -> str:
        """The recovery in words."""
        decided = "no leg left" if math.isinf(self.decided_s) else f"decision after {self.decided_s:.1f} s"
        heard = [] if math.isinf(self.heard_s) else [f"mates after {self.heard_s:.1f} s"]
        return "; ".join([", ".join([f"output after {self.output_s:.1f} s", decided, *heard]), *self.wrong])


class VehicleDay:
    """The day of one vehicle: its faults, one after the other, and the end of its mission.

    Attributes:
        strikes: Faults so far.
        away_s, away_legs: Time (s) from each fault to the next decision, and the legs decided in it.
        ended_s: When its mission had ended (by the steady clock); NaN until then.
    """

    def __init__(self, bed: DiveBed, vehicle: Vehicle, faults: Sequence[Fault], say: Callable[[str], None]) -> None:
        self.vehicle = vehicle
        self.strikes: list[Strike] = []
        self.away_s, self.away_legs, self.ended_s = 0.0, 0, math.nan
        self._bed, self._faults, self._say = bed, deque(faults), say
        self._now: Strike | None = None
        self._began_s = self._progress_s = time.monotonic()
        self._seen_step = -1
        self._maps_m: list[Array] = []  # centers at each fault that struck the map
        self._kills = dict.fromkeys(NODES, 0)

    @property
    def mates(self) -> list[Vehicle]:
        """The other vehicles."""
        return [mate for mate in self._bed.vehicles.values() if mate is not self.vehicle]

    def advance(self) -> bool:
        """Strikes if it is time, watches a recovery; returns whether the day is over.

        Raises:
            RuntimeError: if the vehicle decides nothing any more.
        """
        now_s, ledger = time.monotonic(), self.vehicle.witness.ledger
        if ledger.last_step > self._seen_step:
            self._seen_step, self._progress_s = ledger.last_step, now_s
        if self._now is not None:
            self._watch(self._now)
        elif self._faults and ledger.last_step >= self._faults[0].step:
            self._strike(self._faults.popleft())
        elif not self._faults and self.vehicle.witness.is_in(RunState.ENDED):
            if math.isnan(self.ended_s):
                self.ended_s = now_s
                self._say(f"auv{self.vehicle.number}: the mission has ended")
            return True
        elif now_s > self._progress_s + NEVER_S:
            where = f"auv{self.vehicle.number}: nothing after step {ledger.last_step}"
            raise RuntimeError(f"{where} for {NEVER_S:g} s; see {self.vehicle.out / 'logs'}")
        return False

    def lost_at_end(self, legs: int) -> list[str]:
        """Losses of the vehicle over the whole day; the day must be over."""
        ledger = self.vehicle.witness.ledger
        lost = [f"steps {steps} were not decided"] if (steps := ledger.lost_steps(legs)) else []
        lost += [f"its map lost {number} soundings" for number in ledger.lost_soundings()]
        final_m = self.vehicle.witness.centers_m()
        missing = sum(lost_positions(each, final_m, _center_tolerance_m()) for each in self._maps_m)
        lost += [f"{missing} centers of earlier maps are not in the last one"] if missing else []
        known = [text for strike in self.strikes for text in strike.wrong]
        return lost + [text for text in ledger.broken if text not in known]

    def _strike(self, fault: Fault) -> None:
        witness = self.vehicle.witness
        self._now = Strike(self.vehicle.number, fault, witness.ledger.last_step)
        self._began_s, self._broken = time.monotonic(), len(witness.ledger.broken)
        self._struck = (fault.node,) if fault.node else NODES
        if "gp_node" in self._struck:
            self._maps_m.append(witness.centers_m())
        self._log_sizes = {node: self._log(node).stat().st_size for node in self._struck}
        self._journals = {node: path.read_bytes() for node in self._struck if (path := self._journal(node)).exists()}
        if fault.node:
            self.vehicle.kill(fault.node)
        else:
            self.vehicle.cut_power()
        for node in self._struck:
            self._kills[node] += 1
        if not fault.node:
            self.vehicle.launch()

    def _watch(self, strike: Strike) -> None:
        """Notes what has come back; closes the strike when everything has, or never will."""
        vehicle, witness = self.vehicle, self.vehicle.witness
        died_s = witness.since_s
        try:
            started = vehicle.has_started()
        except RuntimeError as error:
            self._close(strike, [str(error)])
            return
        outputs = {OUTPUTS[node] for node in self._struck if node in OUTPUTS}
        if math.isnan(strike.output_s) and started and outputs <= set(witness.published_s) and self._is_ready():
            strike.output_s = max([witness.published_s[topic] for topic in outputs], default=time.time()) - died_s
        if math.isnan(strike.decided_s) and not math.isnan(strike.output_s):
            if witness.ledger.last_step > strike.step and witness.is_in(RunState.RUNNING, RunState.ENDED):
                strike.decided_s = time.time() - died_s
                self.away_s += time.monotonic() - self._began_s
                self.away_legs += witness.ledger.last_step - strike.step
            elif witness.is_in(RunState.ENDED):
                strike.decided_s = math.inf
        sent_s = witness.published_s.get("modem/tx", math.inf)
        heard = [witness.heard_s.get(mate.number, 0.0) > died_s for mate in self.mates]
        heard += [mate.witness.heard_s.get(vehicle.number, 0.0) > sent_s for mate in self.mates]
        if math.isnan(strike.heard_s) and all(heard):
            strike.heard_s = time.time() - died_s if heard else math.inf  # without mates
        missing = strike.missing()
        if not missing:
            self._close(strike, self._lost_by(strike))
        elif time.monotonic() > self._began_s + NEVER_S:
            self._close(strike, [f"not back after {NEVER_S:g} s: {missing}"])

    def _is_ready(self) -> bool:
        """Whether every node that was struck has reported in its log to be ready."""
        return all("ready after" in self._logged(node) for node in self._struck)

    def _lost_by(self, strike: Strike) -> list[str]:
        """Losses by a fault, once everything is back."""
        witness, lost = self.vehicle.witness, []
        for node, journal in self._journals.items():
            if problem := journal_problem(journal, self._logged(node), self._kills[node]):
                lost.append(f"{node}: {problem}")
        if "gp_node" in self._struck:
            missing = lost_positions(self._maps_m[-1], witness.centers_m(), _center_tolerance_m())
            lost += [f"{missing} of {len(self._maps_m[-1])} centers are not in the next map"] if missing else []
        return lost + sorted(witness.problems) + witness.ledger.broken[self._broken :]

    def _close(self, strike: Strike, wrong: list[str]) -> None:
        strike.wrong += wrong
        self.strikes.append(strike)
        self._now = None
        self._progress_s = time.monotonic()
        self._say(f"auv{strike.vehicle} step {strike.step}: {strike.fault.name}: {strike.text}")

    def _log(self, node: str) -> Path:
        return self.vehicle.out / "logs" / f"auv{self.vehicle.number}.{node}.log"

    def _logged(self, node: str) -> str:
        """The log of a node since it was struck."""
        return self._log(node).read_bytes()[self._log_sizes[node] :].decode(errors="replace")

    def _journal(self, node: str) -> Path:
        found = sorted(self.vehicle.out.glob(f"journal/*/auv{self.vehicle.number}.{node}.journal"))
        return found[-1] if found else Path("none")


def _center_tolerance_m() -> float:
    return SPACINGS * GpConfig().min_spacing_m


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `auv_lse faults day`."""
    default = "(default: %(default)s)"
    parser.add_argument("--vehicles", type=whole_from(1), default=3, metavar="N", help=f"vehicles {default}")
    parser.add_argument("--hours", type=positive, default=5.0, metavar="H", help=f"mission time {default}")
    parser.add_argument("--speed-up", type=positive, default=50.0, metavar="X", help=f"aim {default}")
    parser.add_argument("--method", default="tour", metavar="NAME", help=f"planning method {default}")
    for name, number, what in (("--kills", 10, "kills of nodes"), ("--reboots", 2, "power losses")):
        text = f"{what} of each vehicle {default}"
        parser.add_argument(name, type=whole_from(0), default=number, metavar="N", help=text)


def check(options: argparse.Namespace) -> None:
    """Raises ParameterError, naming the option, for a team or a method that no mission can have."""
    check_option(f"--vehicles {options.vehicles}", "mission.vehicles", options.vehicles)
    check_option(f"--method {options.method}", "planner.method", options.method)
    check_option(f"--hours {options.hours:g}", "mission.steps", max(1, round(options.hours * 3600.0 / LEG_S)))


def run(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Report:
    """Flies the day; the report has the speed-up, restarts at its end, and memory."""
    vehicles, kills, reboots = options.vehicles, options.kills, options.reboots
    legs = max(least_legs(vehicles, kills, reboots), round(options.hours * 3600.0 / LEG_S))
    faults = schedule(vehicles, legs, kills, reboots, np.random.default_rng(options.seed))
    with dive_bed(folder, vehicles) as bed:
        faster = CATCH_UP * options.speed_up
        positions = {"interval_s": PositionsConfig().interval_s / faster, "terrain": False}
        bed.dive("resume", legs, SPEED_MPS * faster, options.method, {"positions": positions})
        began_s = time.monotonic()
        first = {k: vehicle.witness.ledger.last_step for k, vehicle in bed.vehicles.items()}
        days = [VehicleDay(bed, vehicle, faults[k], say) for k, vehicle in bed.vehicles.items()]
        bed.wait(lambda: sum(day.advance() for day in days) == vehicles, math.inf)  # advances every vehicle
        waters = [vehicle.witness for vehicle in bed.vehicles.values()]
        bed.wait(lambda: all("map size" in water.published_s for water in waters), NEVER_S)  # after the last restarts
        sizes = {day.vehicle.number: _memory(day.vehicle) for day in days}
        lost = [f"auv{day.vehicle.number}: {text}" for day in days for text in day.lost_at_end(legs)]
        lost += [f"auv{k}: its processes take {mb:.0f} MB" for k, (mb, _) in sizes.items() if mb > MEMORY_MB]
        packets = {day.vehicle.number: len(day.vehicle.witness.ledger.slots) for day in days}
    strikes = [strike for day in days for strike in day.strikes]
    lost += [f"auv{s.vehicle}, {s.fault.name} at step {s.step}: {text}" for s in strikes for text in s.wrong]
    lines = [*_fault_rows(strikes), "", *_late_rows(days, sizes, packets), ""]
    team = f"{vehicles} vehicle{'s' if vehicles > 1 else ''}, {legs} legs each ({legs * LEG_S / 3600.0:.1f} h, "
    speed = _speed([day.ended_s - began_s for day in days], legs - 1 - max(first.values()), days)
    verdict = "; ".join(lost) or "nothing lost: every step decided once, every journal read back, no sounding lost"
    lines.append(f"{team}{options.method}) {speed} (aim: {options.speed_up:g}); {verdict}")
    worst = max((strike.output_s for strike in strikes if not math.isnan(strike.output_s)), default=None)
    return Report(lines, len(strikes), sum(not strike.wrong for strike in strikes), worst, lost)


def _speed(flown_s: Sequence[float], legs: int, days: Sequence[VehicleDay]) -> str:
    """How fast the mission was, with and without the recoveries; each vehicle has decided `legs` legs in `flown_s`."""
    between = [(legs - day.away_legs) * LEG_S / (s - day.away_s) for day, s in zip(days, flown_s, strict=True)]
    return (
        f"in {max(flown_s):.0f} s: {legs * LEG_S / max(flown_s):.1f} times real time with all recoveries, "
        f"{min(between):.1f} to {max(between):.1f} times between them"
    )


def _fault_rows(strikes: Sequence[Strike]) -> list[str]:
    """The table of all faults by what was killed: median and longest times."""
    lines = [
        "| fault | times | first output after | next decision after | heard again after |",
        "|---|---|---|---|---|",
    ]
    for name in sorted({strike.fault.name for strike in strikes}):
        own = [strike for strike in strikes if strike.fault.name == name]
        columns = (_times([getattr(strike, part) for strike in own]) for part in ("output_s", "decided_s", "heard_s"))
        lines.append(f"| {name} | {len(own)} | {' | '.join(columns)} |")
    return lines


def _times(seconds: Sequence[float]) -> str:
    finite = [s for s in seconds if math.isfinite(s)]
    return f"{np.median(finite):.1f} s, {max(finite):.1f} s" if finite else "-"


def _memory(vehicle: Vehicle) -> tuple[float, str]:
    """Memory (MB) of all processes of a vehicle by share, and in words, with the share of each node."""
    alone_mb, shares = memory_mb(vehicle.pids())
    own = sorted(vehicle.running.nodes.items())
    nodes = ", ".join(f"{name.removesuffix('_node')} {shares.get(pid, 0.0):.0f}" for name, pid in own)
    used_mb = sum(shares.values())
    return used_mb, f"{used_mb:.0f} MB, {alone_mb:.0f} MB alone ({nodes})"


def _late_rows(
    days: Sequence[VehicleDay], sizes: Mapping[int, tuple[float, str]], packets: Mapping[int, int]
) -> list[str]:
    """The table of each vehicle at the end of the day: restarts after it, memory, packets."""
    lines = [
        f"| vehicle | {' | '.join(f'`{node}` killed near the end: first output' for node in LATE)} "
        "| memory: share, and at most alone on a machine (each node's share) | packets sent |",
        "|---|" + "---|" * len(LATE) + "---|---|",
    ]
    for day in days:
        k = day.vehicle.number
        late = {strike.fault.node: strike for strike in day.strikes if strike.fault.late}
        shown = [f"{late[n].output_s:.1f} s" if n in late else "-" for n in LATE]
        lines.append(f"| auv{k} | {' | '.join(shown)} | {sizes[k][1]} | {packets[k]} |")
    lines.append(f"goal: first output within {RESTART_S:g} s; limit: {MEMORY_MB:g} MB for each vehicle")
    return lines
