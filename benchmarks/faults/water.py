"""Bad water and bad clocks: packets lost, doubled, late or damaged, and a vehicle whose clock is wrong.

Missions of three vehicles in one process (the fleet engine). Each fault of the water acts on what the modems have read,
so nothing else changes. A vehicle with a wrong clock uses it for everything: stamps, slots, plans and arrival times.
Its measured travel times are therefore wrong, too.
"""

import argparse
import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.option_types import whole_from
from auv_lse_common.vocabulary.mission_run import Stop
from auv_lse_comms.bridge import Received
from auv_lse_planner.methods.decision import Decision
from auv_lse_shore.judge.evaluation import evaluate
from auv_lse_sim.engine.fleet import Fleet, VehicleCores
from auv_lse_sim.ground.ground_source import ground_of
from auv_lse_sim.water.channel import Arrival
from auv_lse_sim.world import VehicleOutput
from benchmarks.faults.report import Report

SMALL = ("--seeds", "1", "--steps", "40")
#: Bad water may raise the team's risk to this multiple of that of the same mission in good water.
MOST_RISK = 1.25
#: How far a clock is ahead (s) of the true time (s).
Clock = Callable[[float], float]
#: Distorts the packets that one vehicle has read in a tick: (packets, time (s), random stream) -> packets.
Distort = Callable[[list[Arrival], float, np.random.Generator], list[Arrival]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """A kind of bad water.

    Attributes:
        name: For the table.
        parameters: The parameters that it sets.
        make: Makes the distortion of one vehicle's arrivals; None: none.
        clock: The clock of vehicle 2; None: it is right.
    """

    name: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    make: Callable[[], Distort] | None = None
    clock: Clock | None = None


def _bursts() -> Distort:
    """Outages of a minute on average, half of the time."""
    state = {"bad": False, "until_s": 0.0}

    def distort(arrivals: list[Arrival], now_s: float, rng: np.random.Generator) -> list[Arrival]:
        while now_s >= state["until_s"]:
            state["bad"] = not state["bad"]
            state["until_s"] += float(rng.exponential(60.0))
        return [] if state["bad"] else arrivals

    return distort


def _blackout() -> Distort:
    return lambda arrivals, now_s, rng: [] if 200.0 <= now_s < 800.0 else arrivals


def _doubled() -> Distort:
    return lambda arrivals, now_s, rng: [a for a in arrivals for _ in range(2)]


def _reordered() -> Distort:
    """Each packet waits up to 90 s, and so comes after later ones."""
    waiting: list[tuple[float, Arrival]] = []

    def distort(arrivals: list[Arrival], now_s: float, rng: np.random.Generator) -> list[Arrival]:
        waiting.extend((now_s + float(rng.uniform(0.0, 90.0)), a) for a in arrivals)
        due = [entry for entry in waiting if entry[0] <= now_s]
        waiting[:] = [entry for entry in waiting if entry[0] > now_s]
        return [dataclasses.replace(a, arrival_s=then_s) for then_s, a in sorted(due, key=lambda entry: entry[0])]

    return distort


def _damaged() -> Distort:
    """A third of the packets have one to eight flipped bits that no checksum has found."""

    def distort(arrivals: list[Arrival], now_s: float, rng: np.random.Generator) -> list[Arrival]:
        return [
            dataclasses.replace(a, payload=_flipped(a.payload, rng)) if rng.random() < 1 / 3 else a for a in arrivals
        ]

    return distort


def _flipped(payload: bytes, rng: np.random.Generator) -> bytes:
    data = bytearray(payload)
    for bit in rng.integers(8 * len(data), size=int(rng.integers(1, 9))):
        data[bit // 8] ^= 1 << (bit % 8)
    return bytes(data)


FAULTS = (
    *(Fault(name=f"{p} % lost", parameters={"sim.channel.packet_loss": p / 100}) for p in (0, 30, 60, 90, 100)),
    Fault(name="half lost, in bursts of a minute", make=_bursts),
    Fault(name="nothing for 10 min", make=_blackout),
    Fault(name="each packet twice", make=_doubled),
    Fault(name="up to 90 s late, out of order", make=_reordered),
    Fault(name="a third damaged", make=_damaged),
    Fault(name="a clock 2 s ahead", clock=lambda now_s: 2.0),
    Fault(name="a clock 7 s behind", clock=lambda now_s: -7.0),
    Fault(name="a clock that gains 10 s in 15 min", clock=lambda now_s: now_s / 90.0),
    Fault(name="a clock set back by 34 s at 5 min", clock=lambda now_s: -34.0 if now_s >= 300.0 else 0.0),
)
#: The vehicle whose clock is off.
_WRONG_CLOCK_VEHICLE = 2


class _WrongClockCores(VehicleCores):
    """A vehicle's cores with a wrong clock; the world's output has wrong stamps already."""

    def __init__(self, cores: VehicleCores, clock: Clock) -> None:
        vars(self).update(vars(cores))
        self._clock = clock

    def update_safety(self, now_s: float, output: VehicleOutput) -> Stop | None:
        return super().update_safety(now_s + self._clock(now_s), output)

    def decide(self, now_s: float, output: VehicleOutput, heard: list[Received]) -> tuple[Decision, float] | None:
        return super().decide(now_s + self._clock(now_s), output, heard)

    def next_packet(self, now_s: float, decision: Decision | None) -> bytes | None:
        return super().next_packet(now_s + self._clock(now_s), decision)


def _restamped(output: VehicleOutput, mine: Clock, senders: Callable[[int], Clock]) -> VehicleOutput:
    """A tick's output as stamped by the clock `mine`; times at which packets were sent are by their senders' clocks."""

    def at(then_s: float) -> float:
        return then_s + mine(then_s)

    stamps_s = np.array([at(then_s) for then_s in output.soundings.stamp_s])
    arrivals = []
    for a in output.arrivals:
        ahead_s = senders(a.source)(a.sent_s)
        travel_s = a.travel_s + mine(a.start_s) - ahead_s
        arrivals.append(
            dataclasses.replace(
                a, sent_s=a.sent_s + ahead_s, start_s=at(a.start_s), arrival_s=at(a.arrival_s), travel_s=travel_s
            )
        )
    return dataclasses.replace(
        output,
        soundings=dataclasses.replace(output.soundings, stamp_s=stamps_s),
        arrivals=arrivals,
        odometry=dataclasses.replace(output.odometry, stamp_s=at(output.odometry.stamp_s)),
        dead_reckoning=dataclasses.replace(output.dead_reckoning, stamp_s=at(output.dead_reckoning.stamp_s)),
        fixes=[dataclasses.replace(fix, stamp_s=at(fix.stamp_s)) for fix in output.fixes],
    )


class RoughWater(Fleet):
    """A fleet with distorted arrivals or one wrong clock."""

    def __init__(self, settings: Settings, fault: Fault, seed: int) -> None:
        super().__init__(settings, ground_of(settings))
        if fault.clock is not None:
            self._set_clock(fault.clock)
        if fault.make is not None:
            self._spoil(fault.make, np.random.default_rng([seed, 17]))

    def _set_clock(self, clock: Clock) -> None:
        tick = self.world.tick

        def clock_of(number: int) -> Clock:
            return clock if number == _WRONG_CLOCK_VEHICLE else lambda now_s: 0.0

        def restamped(now_s: float) -> dict[int, Any]:
            return {k: _restamped(output, clock_of(k), clock_of) for k, output in tick(now_s).items()}

        self.world.tick = restamped  # type: ignore[method-assign]  # the water, by each vehicle's clock
        self.cores[_WRONG_CLOCK_VEHICLE - 1] = _WrongClockCores(self.cores[_WRONG_CLOCK_VEHICLE - 1], clock)

    def _spoil(self, make: Callable[[], Distort], rng: np.random.Generator) -> None:
        tick = self.world.tick
        distort = {cores.vehicle: make() for cores in self.cores}

        def distorted(now_s: float) -> dict[int, Any]:
            return {
                number: dataclasses.replace(output, arrivals=distort[number](output.arrivals, now_s, rng))
                for number, output in tick(now_s).items()
            }

        self.world.tick = distorted  # type: ignore[method-assign]  # the water, with its fault


@dataclass(frozen=True, slots=True)
class Outcome:
    """Results of a mission: risk and true loss of the team's map, distance of its isobath (m), packets, refusals."""

    risk: float
    loss: float
    isobath_m: float
    accepted: int
    refused: int


def fly(fault: Fault, seed: int, vehicles: int, steps: int) -> Outcome:
    """Flies a mission with a fault."""
    settings = Settings.load(
        None, {"mission.vehicles": vehicles, "mission.steps": steps, "mission.seed": seed, **fault.parameters}
    )
    fleet = RoughWater(settings, fault, seed)
    summary = evaluate(fleet.run()).summary
    counts = [cores.bridge.counts for cores in fleet.cores]
    return Outcome(
        risk=summary.risk_after,
        loss=summary.loss_after or 0.0,
        isobath_m=summary.isobath_error_m or 0.0,
        accepted=sum(c["received"] for c in counts),
        refused=sum(n for c in counts for name, n in c.items() if name.startswith("rejected.")),
    )


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `auv_lse faults water`."""
    parser.add_argument(
        "--seeds", type=whole_from(1), default=4, metavar="N", help="missions of each kind (default: %(default)s)"
    )
    parser.add_argument(
        "--steps", type=whole_from(1), default=60, metavar="N", help="steps of each (default: %(default)s)"
    )


def run(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Report:
    """The table of all faults."""
    seeds, first, steps = options.seeds, options.seed, options.steps
    found: dict[str, list[Outcome]] = {}
    for fault in FAULTS:
        found[fault.name] = [fly(fault, seed, 3, steps) for seed in range(first, first + seeds)]
        say(f"{fault.name}: risk {np.mean([o.risk for o in found[fault.name]]):.3f}")
    lines = [
        "| water | team's risk | true loss | isobath off by | packets taken | refused |",
        "|---|---|---|---|---|---|",
    ]
    for name, outcomes in found.items():
        mean = {f.name: float(np.mean([getattr(o, f.name) for o in outcomes])) for f in dataclasses.fields(Outcome)}
        cells = [f"{mean['risk']:.2f}", f"{mean['loss']:.2f}", f"{mean['isobath_m']:.1f} m"]
        cells += [f"{mean[key]:.0f}" for key in ("accepted", "refused")]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    lines.append(f"means of {seeds} missions of three vehicles and {steps} steps, seeds {first} to {first + seeds - 1}")
    lost = [
        f"{name}, seed {first + i}: risk {o.risk:.2f} against {good.risk:.2f} in good water"
        for name, outcomes in found.items()
        for i, (o, good) in enumerate(zip(outcomes, found[FAULTS[0].name], strict=True))
        if not o.risk <= MOST_RISK * good.risk
    ]
    return Report(lines, tried=len(FAULTS) * seeds, survived=len(FAULTS) * seeds - len(lost), lost=lost)
