"""A long mission under load: soundings at 50 Hz, and team mates that send too much. Memory and time are sampled.

One process runs the algorithms of one vehicle of a large team, as its nodes do. Its team mates are not simulated: a few
of them send valid packets far more often than their slots allow.
"""

import argparse
import dataclasses
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.arrays import Array
from auv_lse_common.support.free_memory import return_free_memory
from auv_lse_common.support.option_types import positive, whole_from
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_comms.packet.codec import Packet, encode
from auv_lse_shore.mission.warm_up import main as warm_up
from auv_lse_shore.mission_options import check_option
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of
from auv_lse_sim.water.channel import Arrival
from auv_lse_sim.world import VehicleOutput
from benchmarks.faults.report import Report

#: Soundings a second; packets a second of each babbling vehicle, and the number of these.
SOUNDINGS_HZ = 50
PACKETS_HZ = 2
BABBLERS = 4
#: Largest growth of memory (MB) over the second half.
GROWTH_MB = 150.0


@dataclass(frozen=True, slots=True)
class Sample:
    """A sample: mission time (s), memory (MB), kernel centers; longest decision and tick since (s of processor)."""

    now_s: float
    memory_mb: float
    centers: int
    decision_s: float
    tick_s: float


def memory_mb() -> float:
    """Resident memory of this process (MB)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _loaded(
    output: VehicleOutput, fleet: Fleet, now_s: float, corners: Array, rng: np.random.Generator
) -> VehicleOutput:
    """A tick's output with soundings at `SOUNDINGS_HZ`, and the packets of the babbling vehicles."""
    count = len(output.soundings)
    repeated = output.soundings[np.repeat(np.arange(count), max(1, SOUNDINGS_HZ // max(1, count)))]
    noisy_m = repeated.depth_m + 0.05 * rng.standard_normal(len(repeated))
    arrivals = list(output.arrivals)
    for number in range(BABBLERS * PACKETS_HZ if fleet.settings.mission.vehicles > BABBLERS else 0):
        positions = rng.uniform(corners.min(axis=0), corners.max(axis=0), (15, 2))
        depths = np.nan_to_num(fleet.ground.depth_m(positions[:, 0], positions[:, 1]), nan=10.0)
        plan = Plan.at(int(now_s / 15.7), np.array([0.3, *positions[0]]), (5,) * 10, NONE)
        payload = encode(Packet(plan, np.column_stack([positions, depths])))
        arrival = Arrival(
            receiver=1,
            source=2 + number % BABBLERS,
            payload=payload,
            sent_s=now_s - 2.5,
            start_s=now_s - 2.0,
            arrival_s=now_s,
            snr_db=20.0,
            range_m=100.0,
            ok=True,
            why="",
        )
        arrivals.append(arrival)
    return dataclasses.replace(output, soundings=dataclasses.replace(repeated, depth_m=noisy_m), arrivals=arrivals)


def _steps(minutes: float) -> int:
    """Legs of each vehicle in some minutes."""
    return max(4, int(minutes * 60.0 / 15.7))


def soak(minutes: float, vehicles: int, seed: int, say: Callable[[str], None]) -> tuple[list[Sample], Fleet]:
    """Runs the cores of vehicle 1 for some minutes of mission time; returns ten samples, and the fleet."""
    warm_up()  # loads and compiles code in advance, which the first decision must not count
    settings = Settings.load(
        None, {"mission.vehicles": vehicles, "mission.steps": _steps(minutes), "mission.seed": seed}
    )
    fleet = Fleet(settings, ground_of(settings))
    cores, rng = fleet.cores[0], np.random.default_rng(seed)
    corners = np.reshape(settings.area.polygon_m, (-1, 2))
    samples: list[Sample] = []
    ticks, decision_s, tick_s = int(minutes * 60.0), 0.0, 0.0
    for tick in range(1, ticks + 1):
        output = _loaded(fleet.world.tick(float(tick))[1], fleet, float(tick), corners, rng)
        began = time.process_time()
        heard = cores.receive(output)
        cores.update_map(output, heard)
        deciding = time.process_time()
        decided = cores.decide(float(tick), output, heard)
        cores.next_packet(float(tick), decided[0] if decided else None)
        tick_s = max(tick_s, time.process_time() - began)
        if decided:
            decision_s = max(decision_s, time.process_time() - deciding)
            fleet.world.command(1, decided[0].leg)
        if tick % max(1, ticks // 10) == 0:
            return_free_memory()  # as a vehicle's nodes do every second
            samples.append(Sample(float(tick), memory_mb(), len(cores.map.gp), decision_s, tick_s))
            say(f"{tick / 60.0:.1f} min of the mission: {samples[-1].memory_mb:.0f} MB, {len(cores.map.gp)} centers")
            decision_s = tick_s = 0.0
    return samples, fleet


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `auv_lse faults soak`."""
    parser.add_argument(
        "--minutes", type=positive, default=30.0, metavar="N", help="mission time (default: %(default)s)"
    )
    parser.add_argument(
        "--vehicles", type=whole_from(1), default=20, metavar="N", help="vehicles (default: %(default)s)"
    )


def check(options: argparse.Namespace) -> None:
    """Raises ParameterError, naming the option, for a team or a time that no mission can have."""
    check_option(f"--vehicles {options.vehicles}", "mission.vehicles", options.vehicles)
    check_option(f"--minutes {options.minutes:g}", "mission.steps", _steps(options.minutes))


def run(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Report:
    """The table of a soak, and whether memory and the map stayed bounded."""
    samples, fleet = soak(options.minutes, options.vehicles, options.seed, say)
    cores = fleet.cores[0]
    lines = ["| mission time | memory | centers | longest decision | longest tick |", "|---|---|---|---|---|"]
    for s in samples:
        sizes = f"{s.memory_mb:.0f} MB | {s.centers}"
        lines.append(f"| {s.now_s / 60.0:.1f} min | {sizes} | {s.decision_s:.2f} s | {s.tick_s:.2f} s |")
    counts, most = cores.map.counts, cores.map.gp.config.max_centers
    lines.append(
        f"{cores.bridge.counts['received']} packets taken, {cores.bridge.counts['rejected.excess']} refused as excess; "
        f"{counts.kept} soundings and samples kept, {counts.merged + counts.too_close} merged or too close, "
        f"{counts.outliers} outliers, {counts.full} discarded (gp.max_centers = {most})"
    )
    growth_mb = samples[-1].memory_mb - samples[len(samples) // 2].memory_mb
    lines.append(f"memory grew by {growth_mb:.0f} MB over the second half (limit {GROWTH_MB:.0f} MB)")
    lost = [] if growth_mb < GROWTH_MB else [f"memory grew by {growth_mb:.0f} MB"]
    lost += [] if samples[-1].centers <= most else [f"{samples[-1].centers} centers of {most}"]
    return Report(lines, tried=1, survived=0 if lost else 1, lost=lost)
