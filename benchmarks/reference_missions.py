"""Shows that a change of the code changes no decision: flies reference missions, compares packets and figures of merit.

    python -m benchmarks.reference_missions --write before.json      # before the change
    python -m benchmarks.reference_missions --compare before.json    # after it

Packets are compared byte for byte (by hash), figures of merit to a relative 1e-12. Planning time is left out.
Figures hold for one machine and one set of libraries: another BLAS rounds differently.
"""

import hashlib
import json
import math
import os
import time
from pathlib import Path
from typing import Any

# With more threads, BLAS sums in another order, which changes some decision.
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

from auv_lse_common.mission_file.settings import Settings
from auv_lse_shore.judge.evaluation import evaluate
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of
from benchmarks.command import end_with, parser_of

#: Largest relative difference between two figures of merit that are called the same.
TOLERANCE = 1e-12

#: Figures of the machine's clock.
CLOCK_FIGURES = ("planning_median_s", "planning_max_s", "wall_s")

#: Missions that together cover every method and option that affects decisions.
MISSIONS: dict[str, dict[str, Any]] = {
    "tour": {"planner.method": "tour"},
    "augmented": {
        "planner.method": "augmented",
        "mission.vehicles": 2,
        "mission.steps": 60,
        "mission.seed": 7,
        "sim.channel.packet_loss": 0.3,
    },
    "fixed_tour": {"planner.method": "fixed_tour", "mission.steps": 60, "mission.seed": 3},
    "plain": {"planner.method": "plain", "mission.steps": 50, "mission.seed": 4},
    "lawnmower": {"planner.method": "lawnmower", "mission.seed": 6},
    "straddle": {"planner.method": "straddle", "mission.vehicles": 1, "mission.steps": 60, "mission.seed": 8},
    "three_positions_a_leg": {
        "planner.samples_per_leg": 3,
        "planner.method": "augmented",
        "gp.kernel": "wendland_c2",
        "mission.vehicles": 2,
        "mission.steps": 25,
        "mission.seed": 10,
    },
    "no_merging": {"gp.merge": False, "mission.steps": 30, "mission.seed": 11},
}


def fly(overrides: dict[str, Any]) -> dict[str, Any]:
    """Flies one mission in the fleet engine: {"packets": hash of all, "count": their number, "figures": by name}."""
    settings = Settings.load(None, overrides)
    fleet = Fleet(settings, ground_of(settings))
    run = fleet.run()
    digest = hashlib.sha256()
    for packet in run.sent:
        digest.update(f"{packet.stamp_s!r} {packet.source} ".encode() + packet.payload)
    figures = json.loads(evaluate(run).summary.to_json())
    return {
        "packets": digest.hexdigest(),
        "count": len(run.sent),
        "figures": {k: v for k, v in figures.items() if k not in CLOCK_FIGURES},
    }


def differences(before: Any, now: Any, where: str = "") -> list[str]:
    """The differences between two results, a line each."""
    if isinstance(before, dict) and isinstance(now, dict):
        found = [f"{where}.{k}: missing now" for k in sorted(before.keys() - now.keys())]  # new figures are allowed
        return found + [d for k in before if k in now for d in differences(before[k], now[k], f"{where}.{k}")]
    if isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        return [d for i, pair in enumerate(zip(before, now, strict=True)) for d in differences(*pair, f"{where}[{i}]")]
    if isinstance(before, float) and isinstance(now, float):
        same = math.isclose(before, now, rel_tol=TOLERANCE, abs_tol=TOLERANCE)
    else:
        same = before == now
    return [] if same else [f"{where}: {before!r} before, {now!r} now"]


def main(arguments: list[str] | None = None) -> int:
    """Command line. Returns 1 if missions differ."""
    parser = parser_of("benchmarks.reference_missions", __doc__)
    parser.add_argument("--write", type=Path, metavar="FILE", help="write the results of the missions")
    parser.add_argument("--compare", type=Path, metavar="FILE", help="fly them again and compare with this file")
    parser.add_argument("--only", nargs="+", choices=MISSIONS, metavar="NAME", help=f"of {', '.join(MISSIONS)}")
    options = parser.parse_args(arguments)
    if (options.write is None) == (options.compare is None):
        parser.error("give either --write FILE or --compare FILE")
    before: dict[str, Any] = {}
    if options.compare is not None:
        try:
            before = json.loads(options.compare.read_text())
        except (OSError, ValueError) as error:
            parser.error(f"--compare {options.compare}: {error}; name a file that --write has written")
    results: dict[str, Any] = {}
    found: list[str] = []
    for name in options.only or MISSIONS:
        began = time.process_time()
        results[name] = fly(MISSIONS[name])
        spent = time.process_time() - began
        news = differences(before.get(name), results[name], name) if before else []
        found += news
        state = "" if not before else ": differs" if news else ": the same"
        line = f"{name}: {results[name]['count']} packets, {results[name]['packets'][:12]}{state}"
        print(f"{line} ({spent:.1f} s of processor time)", flush=True)
    if options.write is not None:
        options.write.write_text(json.dumps(results, indent=1) + "\n")
    print("\n".join(found) if found else "")
    return int(bool(found))


if __name__ == "__main__":
    end_with(main)
