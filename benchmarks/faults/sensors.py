"""Bad sensors: depth with a wrong datum; pressure that drifts, freezes or stops; wrong altitudes and stamps.

One vehicle with a simulated autopilot travels a straight line over a slope, under its safety watch. Each fault begins
at a random moment, and the run is judged by the true depth of the vehicle and of the water.
"""

import argparse
import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.mission_file.sections.safety import SafetyConfig
from auv_lse_common.safety.fence import Fence
from auv_lse_common.safety.watch import SafetyWatch
from auv_lse_common.support.option_types import whole_from
from auv_lse_common.topics.records import Altitude
from auv_lse_common.vocabulary.extent import Extent
from auv_lse_common.vocabulary.mission_run import Action, MissionRun, Stop
from auv_lse_common.vocabulary.sounding_gate import SoundingGate
from auv_lse_mavlink.messages.datum import Origin
from auv_lse_mavlink.messages.events import AutopilotEstimate, AutopilotState
from auv_lse_mavlink.messages.wire import mavlink
from auv_lse_mavlink.sounder import Sounder
from auv_lse_sim.emulated.autopilot_report import Report as Sensed
from benchmarks.faults.report import Report
from benchmarks.navigation.lone_vehicle import LoneVehicle

#: Arguments of a run of a minute.
SMALL = ("--seeds", "5")
#: Travel depth, time to reach it, length of a run, and the times between which a fault begins.
DEPTH_M, DIVE_S, RUN_S, BEGIN_S = 5.0, 30, 240, (5.0, 120.0)
#: Length of a leg (m): an ArduSub follows the straight line to its target, so it is at its depth after the first leg.
LEG_M = 20.0
#: How well the vehicle keeps its depth, and how well a sounding fits the ground (m).
KEEPING_M, SOUNDING_M = 0.3, 1.0
#: Accepted share of wrong soundings.
WRONG_SHARE = 0.05
_ORIGIN = Origin(lat_deg=46.5, lon_deg=6.6)


class Slope:
    """Ground that falls by 3 m in 100 m to the north."""

    extent = Extent(north_min_m=-1e4, north_max_m=1e4, east_min_m=-1e4, east_max_m=1e4)
    origin = (_ORIGIN.lat_deg, _ORIGIN.lon_deg)

    def depth_m(self, north_m: Any, east_m: Any) -> Any:
        """Water depth (m)."""
        return 14.0 + 0.03 * np.asarray(north_m) + 0.0 * np.asarray(east_m)

    def describe(self) -> str:
        """For the log."""
        return "a slope"


#: Changes what the autopilot measures from a time on: (report, time since the begin (s), random stream).
Distort = Callable[[Sensed, float, np.random.Generator], Sensed]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """A kind of bad sensor.

    Attributes:
        name: For the table.
        tolerance_m: Largest error of the vehicle's depth, besides how well it keeps it.
        parameters: Draws parameters.
        distort: Makes what changes the measurements.
        drops: Id of the message that no longer arrives.
        old: Whether stamps of odometry stop.
        jump_m: The autopilot's own depth jumps by up to this.
        trips: The limit that must trip; "" none must, None either is right.
        warns: The limit of which the watch must warn; "": none.
    """

    name: str
    tolerance_m: float = 0.0
    parameters: Callable[[np.random.Generator], dict[str, Any]] = lambda rng: {}
    distort: Callable[[], Distort] | None = None
    drops: int = -1
    old: bool = False
    jump_m: float = 0.0
    trips: str | None = ""
    warns: str = ""


def _frozen(name: str) -> Callable[[], Distort]:
    def make() -> Distort:
        last: list[float] = []

        def distort(report: Sensed, passed_s: float, rng: np.random.Generator) -> Sensed:
            if passed_s < 0.0 or not last:
                last[:] = [getattr(report, name)]
            return dataclasses.replace(report, **{name: last[0]})  # type: ignore[arg-type]  # a number

        return distort

    return make


def _air(hpa: float) -> Callable[[], Distort]:
    def distort(report: Sensed, passed_s: float, rng: np.random.Generator) -> Sensed:
        return dataclasses.replace(report, pressure_pa=report.pressure_pa + 100.0 * hpa * (passed_s >= 0.0))

    return lambda: distort


def _altitudes(share: float, wrong: Callable[[float, np.random.Generator], float]) -> Callable[[], Distort]:
    def distort(report: Sensed, passed_s: float, rng: np.random.Generator) -> Sensed:
        if passed_s < 0.0 or rng.random() >= share:
            return report
        return dataclasses.replace(report, altitude_m=wrong(report.altitude_m, rng))

    return lambda: distort


FAULTS = (
    Fault(name="nothing"),
    Fault(name="origin up to 20 m off", parameters=lambda rng: {"origin_height_m": float(rng.uniform(-20.0, 20.0))}),
    Fault(name="own depth jumps by up to 0.9 m", tolerance_m=0.9, jump_m=0.9),
    Fault(name="own depth jumps by 3 to 8 m", tolerance_m=1.0, jump_m=8.0, trips="pressure", warns="pressure"),
    Fault(
        name="barometer drifts by up to 300 hPa/h",
        tolerance_m=0.25,
        parameters=lambda rng: {"barometer_drift_hpa_h": float(rng.uniform(-300.0, 300.0))},
    ),
    Fault(name="air pressure changes by 8 hPa", tolerance_m=0.1, distort=_air(8.0)),
    Fault(
        name="sensor's offset up to 200 hPa, air 700 to 1050 hPa",
        parameters=lambda rng: {
            "barometer_offset_hpa": float(rng.uniform(-100.0, 150.0)),
            "air_pressure_hpa": float(rng.uniform(700.0, 1050.0)),
        },
    ),
    Fault(name="salt water taken for fresh", tolerance_m=0.15, parameters=lambda rng: {"water_density_kgpm3": 1028.0}),
    Fault(name="pressure frozen", tolerance_m=1.0, distort=_frozen("pressure_pa"), trips=None),
    Fault(name="pressure stops", drops=mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE2, trips="pressure", warns="pressure"),
    Fault(name="altimeter frozen", distort=_frozen("altitude_m"), warns="altimeter"),
    Fault(name="half of the altitudes missing", distort=_altitudes(0.5, lambda altitude_m, rng: math.nan)),
    Fault(
        name="a tenth of the altitudes up to 8 m wrong",
        distort=_altitudes(0.1, lambda altitude_m, rng: max(altitude_m + float(rng.uniform(-8.0, 8.0)), 0.6)),
    ),
    Fault(name="stamps of odometry stop", tolerance_m=DEPTH_M, old=True, trips="odometry", warns="odometry"),
)


@dataclass(slots=True)
class Outcome:
    """Results of a run.

    Attributes:
        depth_error_m: Largest error of the vehicle's depth, after the dive, while it is not at the surface.
        wrong: Share of soundings that passed the gate and are wrong.
        soundings: Soundings that passed.
        response_s: Time from the fault to the response; NaN without one.
        tripped: Limits that tripped.
        warned: Limits of which the watch warned.
        stopped: What the vehicle does at the end.
    """

    depth_error_m: float = 0.0
    wrong: float = 0.0
    soundings: int = 0
    response_s: float = math.nan
    tripped: set[str] = field(default_factory=set)
    warned: set[str] = field(default_factory=set)
    stopped: Action | None = None

    def failure(self, fault: Fault) -> str:
        """What went wrong; "" if nothing did."""
        if self.depth_error_m > fault.tolerance_m + KEEPING_M:
            return f"{fault.name}: {self.depth_error_m:.2f} m off its depth"
        if self.wrong > WRONG_SHARE:
            return f"{fault.name}: {100.0 * self.wrong:.0f} % of the soundings are wrong"
        if fault.trips is not None and self.tripped != ({fault.trips} - {""}):
            return f"{fault.name}: tripped {sorted(self.tripped)} instead of {fault.trips or 'nothing'}"
        if fault.warns and fault.warns not in self.warned | self.tripped:
            return f"{fault.name}: no warning"
        return ""


class _Run:
    """One vehicle, its watch, its sounder and its gate."""

    def __init__(self, fault: Fault, seed: int) -> None:
        self._rng = np.random.default_rng([seed, 29])
        drawn = {f"sim.autopilot.{name}": value for name, value in fault.parameters(self._rng).items()}
        self._fault, self._begin_s = fault, float(self._rng.uniform(*BEGIN_S))
        if fault.distort is None or "frozen" not in fault.name:  # a frozen gauge also in the dive
            self._begin_s = max(self._begin_s, float(DIVE_S))
        self._vehicle = vehicle = LoneVehicle(
            Slope(), _ORIGIN, {"mission.seed": seed, "vehicle.depth_m": DEPTH_M, **drawn}
        )
        distort = fault.distort() if fault.distort is not None else None
        if distort is not None:
            vehicle.distort = lambda now_s, report: distort(report, now_s - self._begin_s, self._rng)
        vehicle.passes = lambda datagram: datagram[7] != fault.drops or vehicle.now_s < self._begin_s
        self._watch = SafetyWatch(SafetyConfig(), Fence((0.0, 0.0, 0.0, 1e4, 1e4, 1e4), 1e4), DEPTH_M + 5.0, True)
        self._run = MissionRun(True, Stop(action=Action.SURFACE))
        self._sounder, self._gate = Sounder(1.0, 1), SoundingGate()
        self._wrong = self._legs = 0
        self.outcome = Outcome()

    def fly(self) -> Outcome:
        """Flies the run."""
        outcome, vehicle = self.outcome, self._vehicle
        for _ in range(RUN_S):
            self._tick()
            outcome.tripped |= set(self._run.limits)
            outcome.warned |= set(self._watch.warnings)
            if outcome.tripped and math.isnan(outcome.response_s):
                outcome.response_s = vehicle.now_s - self._begin_s
        stop = self._run.status.stop
        outcome.stopped = None if stop is None else stop.action
        outcome.wrong = self._wrong / max(outcome.soundings, 1)
        return outcome

    def _tick(self) -> None:
        vehicle, heard = self._vehicle, len(self._vehicle.events)
        if self._fault.jump_m and vehicle.now_s < self._begin_s <= vehicle.now_s + 1.0:
            low_m = 3.0 if self._fault.jump_m > 3.0 else 0.0
            size_m = float(self._rng.uniform(low_m, self._fault.jump_m) * self._rng.choice([-1.0, 1.0]))
            vehicle.vehicle.move_origin(size_m)
        if len(vehicle.link.targets) < 2 and self._run.status.stop is None:
            vehicle.leg(self._legs, LEG_M)
            self._legs += 1
        output = vehicle.tick()
        for event in vehicle.events[heard:]:
            if isinstance(event, AutopilotState):
                self._watch.autopilot(event.report)
            elif isinstance(event, Altitude):
                self._watch.altitude(event.altitude_m)
                self._sounder.altitude(event.stamp_s, event.altitude_m)
            elif isinstance(event, AutopilotEstimate):
                self._take(event)
        self._watch.step(vehicle.now_s, self._run)
        vehicle.link.stop(vehicle.now_s, self._run.status.stop)
        surfaces = self._run.status.stop is not None and self._run.status.stop.action is Action.SURFACE
        if vehicle.now_s > DIVE_S and not surfaces:
            error_m = abs(output.truth.depth_m - DEPTH_M)
            self.outcome.depth_error_m = max(self.outcome.depth_error_m, error_m)

    def _take(self, estimate: AutopilotEstimate) -> None:
        e = estimate
        stamp_s = min(e.stamp_s, self._begin_s) if self._fault.old else e.stamp_s
        self._watch.odometry(stamp_s, e.heading_rad, e.north_m, e.east_m, e.depth_m, e.speed_mps)
        if self._vehicle.link.report.depth_problem:
            self._sounder.reset()
            return
        for sounding in self._gate.passed(self._sounder.odometry(stamp_s, e.north_m, e.east_m, e.depth_m)):
            self.outcome.soundings += 1
            true_m = float(Slope().depth_m(sounding[1], sounding[2]))
            self._wrong += abs(sounding[3] - true_m) > SOUNDING_M


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `auv_lse faults sensors`."""
    parser.add_argument(
        "--seeds", type=whole_from(1), default=10, metavar="N", help="runs of each fault (default: %(default)s)"
    )


def run(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Report:
    """The table of all faults."""
    lines = [
        "| sensors | off its depth | wrong soundings | response after | tripped | survived |",
        "|---|---|---|---|---|---|",
    ]
    lost: list[str] = []
    slowest_s, tried, failed = 0.0, 0, 0
    for fault in FAULTS:
        outcomes = [_Run(fault, seed).fly() for seed in range(options.seed, options.seed + options.seeds)]
        failures = [why for outcome in outcomes if (why := outcome.failure(fault))]
        lost += failures[:1]
        tried += len(outcomes)
        lines.append(_row(fault, outcomes, len(failures)))
        responses_s = [o.response_s for o in outcomes if not math.isnan(o.response_s)]
        slowest_s = max([slowest_s, *responses_s])
        say(lines[-1])
        failed += len(failures)
    lines.append(
        f"largest of {options.seeds} runs each, {RUN_S} s at {DEPTH_M:g} m; it keeps its depth within {KEEPING_M:g} m"
    )
    return Report(lines, tried=tried, survived=tried - failed, worst_recovery_s=slowest_s, lost=lost)


def _row(fault: Fault, outcomes: Sequence[Outcome], failed: int) -> str:
    off_m, wrong = max(o.depth_error_m for o in outcomes), max(o.wrong for o in outcomes)
    responses_s = [o.response_s for o in outcomes if not math.isnan(o.response_s)]
    response = f"{max(responses_s):.0f} s" if responses_s else "-"
    tripped = ", ".join(sorted(set().union(*(o.tripped for o in outcomes)))) or "-"
    survived = len(outcomes) - failed
    return f"| {fault.name} | {off_m:.2f} m | {wrong:.1%} | {response} | {tripped} | {survived} of {len(outcomes)} |"
