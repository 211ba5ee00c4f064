"""scripts/reproduce: the paper's results in simulation, over many seeds, with its claims checked one by one.

Three campaigns (see `campaign.py`), each resumed where it was stopped: the field trials (teams of 2 and 3, the paper's
two methods, the lawnmower and our own), the same in an area large enough that three vehicles do not saturate it, and
sensitivity to one parameter at a time. Then one mission of each kind in full, for the paper's figures.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auv_lse_common.params import ParameterError
from auv_lse_sim.campaign.campaign import (
    CampaignError,
    Progress,
    add_cluster_options,
    cluster,
    columns_of,
    default_root,
    display,
    duration,
    finish,
    fly,
    fly_run,
    run_campaign,
)
from auv_lse_sim.campaign.rows import Rows
from auv_lse_sim.campaign.spec import CampaignSpec
from auv_lse_sim.judge.evaluation import Evaluation, evaluate
from auv_lse_sim.judge.report import write_outputs
from auv_lse_sim.record import bag
from auv_lse_sim.record.run_data import GroundGrid

#: The methods compared: the paper's two, its floor, and ours.
METHODS = ("augmented", "plain", "lawnmower", "best")

#: The methods whose sensitivity is shown.
SENSITIVE = ("augmented", "plain", "best")

#: An area in which three vehicles cannot see everything in 100 steps: four times the field trial's.
LARGE: Mapping[str, Any] = {
    "area.polygon_m": [-50.0, -50.0, 1150.0, -50.0, 1150.0, 1350.0, -50.0, 1350.0],
    "sim.lake.north_m": 550.0,
    "sim.lake.east_m": 650.0,
    "sim.lake.height_m": 1200.0,
    "sim.lake.width_m": 1400.0,
    "gp.map_resolution_m": 10.0,
}

#: A small area and mission for --quick.
SMALL: Mapping[str, Any] = {
    "mission.steps": 40,
    "area.polygon_m": [-50.0, -50.0, 350.0, -50.0, 350.0, 400.0, -50.0, 400.0],
    "sim.lake.north_m": 150.0,
    "sim.lake.east_m": 175.0,
    "sim.lake.height_m": 400.0,
    "sim.lake.width_m": 450.0,
}

#: Navigation errors as multiples of the default bias of the compass, and scale and noise of the DVL.
NAVIGATION: Mapping[float, Mapping[str, Any]] = {
    0.0: {"sim.navigation.ideal": True},
    1.0: {},
    3.0: {"sim.compass.bias_deg": 3.0, "sim.dvl.scale": 0.009, "sim.dvl.noise_mps": 0.03},
    10.0: {"sim.compass.bias_deg": 10.0, "sim.dvl.scale": 0.03, "sim.dvl.noise_mps": 0.1},
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """Sensitivity to one parameter.

    Attributes:
        name: Short name.
        label: Name on the axis, with unit.
        points: Value on the axis, and the parameters that it stands for.
        default: The value that the mission has anyway, flown once for all sweeps; None where methods differ in it.
    """

    name: str
    label: str
    points: tuple[tuple[float, Mapping[str, Any]], ...]
    default: float | None = None


def _one(name: str, label: str, parameter: str, values: Sequence[float], default: float | None = None) -> Sweep:
    return Sweep(name=name, label=label, points=tuple((float(v), {parameter: v}) for v in values), default=default)


def _costs(ratio: float) -> Mapping[str, Any]:
    share = 20.0 / (1.0 + ratio)
    return {"level_set.cost_false_safe": ratio * share, "level_set.cost_false_unsafe": share}


#: Every sensitivity asked for; the default's value is among each one's.
SWEEPS = (
    _one("loss", "packets lost (share)", "sim.channel.packet_loss", [0.0, 0.2, 0.4, 0.6, 0.8, 1.0], 0.0),
    _one("slot", "slot length (s)", "tdma.slot_s", [5.0, 10.0, 20.0, 40.0], 10.0),
    Sweep(
        name="navigation",
        label="compass bias, DVL scale and noise (× default)",
        points=tuple(NAVIGATION.items()),
        default=1.0,
    ),
    _one("team", "vehicles", "mission.vehicles", [1, 2, 3, 4, 5, 6, 7, 8], 3.0),
    _one("horizon", "horizon m (legs)", "planner.horizon", [1, 3, 6, 10, 15]),
    _one("iterations", "tree search iterations", "planner.iterations", [50, 100, 150, 300, 1000]),
    Sweep(
        name="costs",
        label="c1 / c2 (c1 + c2 = 20)",
        points=tuple((ratio, _costs(ratio)) for ratio in (0.25, 0.5, 1.0, 2.0, 4.0)),
        default=1.0,
    ),
)


def trial_name(vehicles: int, method: str) -> str:
    """Name of a setting of the field trials."""
    return f"{vehicles} AUVs, {method}"


def sweep_name(sweep: Sweep, value: float, method: str) -> str:
    """Name of a setting of the sensitivities."""
    return f"default, {method}" if value == sweep.default else f"{sweep.name} {value:g}, {method}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What is flown.

    Attributes:
        name: "full" or "quick".
        campaigns: The campaigns, by name ("trials", "large", "sensitivity"), in order.
        sweeps: The sensitivities that the last one holds.
        teams: Team sizes of the trials.
        large_team: Team size in the large area.
        shown: Settings of the trials of which one mission is flown for the figures: team size, method.
        budget_s: Time after which no further mission is handed out, over all campaigns.
        only: Names of the campaigns that are flown now; the page has all of them.
    """

    name: str
    campaigns: Mapping[str, CampaignSpec]
    sweeps: tuple[Sweep, ...]
    teams: tuple[int, ...]
    large_team: int
    shown: tuple[tuple[int, str], ...]
    budget_s: float
    only: tuple[str, ...] = ("trials", "large", "sensitivity")

    @property
    def flown(self) -> dict[str, CampaignSpec]:
        """The campaigns that are flown now."""
        return {name: spec for name, spec in self.campaigns.items() if name in self.only}


def base_mission() -> Path:
    """The default mission: the paper's field trial."""
    root = Path(os.environ.get("AUV_LSE_ROOT", Path(__file__).resolve().parents[3]))
    return root / "config" / "missions" / "default.yaml"


def full_plan(seeds: int, sweep_seeds: int, only: Sequence[str], sweep_methods: Sequence[str] = SENSITIVE) -> Plan:
    """Everything: the trials over `seeds` seeds, large area and sensitivities (of `sweep_methods`) over fewer."""
    trials = [{"label": trial_name(k, m), "mission.vehicles": k, "planner.method": m} for k in (2, 3) for m in METHODS]
    large = [{"label": trial_name(3, m), "mission.vehicles": 3, "planner.method": m} for m in METHODS]
    campaigns = {
        "trials": _spec("trials", trials, {}, seeds),
        "large": _spec("large", large, LARGE, max(sweep_seeds, min(seeds, 20))),
        "sensitivity": _spec("sensitivity", _swept(SWEEPS, sweep_methods), {}, sweep_seeds),
    }
    return Plan(
        name="full",
        campaigns=campaigns,
        only=tuple(only),
        sweeps=SWEEPS,
        teams=(2, 3),
        large_team=3,
        shown=tuple((k, m) for k in (2, 3) for m in SENSITIVE),
        budget_s=float("inf"),
    )


def quick_plan(budget_s: float) -> Plan:
    """As many seeds of a small mission as fit the time, and three packet losses."""
    trials = [{"label": trial_name(k, m), "mission.vehicles": k, "planner.method": m} for k in (2, 3) for m in METHODS]
    sweeps = (_one("loss", "packets lost (share)", "sim.channel.packet_loss", [0.0, 0.5, 1.0], 0.0),)
    campaigns = {
        "trials": _spec("trials", trials, SMALL, 50),
        "sensitivity": _spec("sensitivity", _swept(sweeps, ("augmented",)), SMALL, 50),
    }
    return Plan(
        name="quick",
        campaigns=campaigns,
        sweeps=sweeps,
        teams=(2, 3),
        large_team=3,
        shown=tuple((3, m) for m in SENSITIVE),
        budget_s=budget_s,
    )


def _spec(name: str, settings: list[dict[str, Any]], common: Mapping[str, Any], seeds: int) -> CampaignSpec:
    content = {"name": name, "mission": str(base_mission()), "set": dict(common), "list": settings, "seeds": seeds}
    return CampaignSpec.from_mapping(content, f"reproduce: {name}", base_mission().parent)


def _swept(sweeps: Sequence[Sweep], methods: Sequence[str]) -> list[dict[str, Any]]:
    settings: dict[str, dict[str, Any]] = {}
    for sweep in sweeps:
        for value, parameters in sweep.points:
            for method in methods:
                label = sweep_name(sweep, value, method)
                own = {} if value == sweep.default else parameters
                settings.setdefault(label, {"label": label, "planner.method": method, "mission.vehicles": 3, **own})
    return list(settings.values())


# Flying ---------------------------------------------------------------------------------------------------------------


def estimate_s(plan: Plan, folder: Path, client: Any, threads: int) -> float:
    """Time (s) that the missions without a row will take.

    A setting with rows takes what they took; the others, what a tenth of such a mission takes here now, times ten.
    """
    total = 0.0
    probes: dict[tuple[str, str], list[Any]] = {}
    left: dict[tuple[str, str], int] = {}
    for name, spec in plan.flown.items():
        rows = Rows(folder / name, columns_of(spec)).read()
        have = {row["id"] for row in rows}
        for job in spec.jobs():
            if job.id in have:
                continue
            known = [row["busy_s"] for row in rows if row["group"] == job.group and row["busy_s"]]
            if known:
                total += sum(known) / len(known)
                continue
            common = job.patterns["/**"]
            kind = (name, str(common["planner"]["method"]))
            left[kind] = left.get(kind, 0) + 1
            if kind not in probes:
                short = max(2, int(common["mission"]["steps"]) // 10)
                probe = json.loads(json.dumps(job.patterns))
                probe["/**"]["mission"]["steps"] = short
                future = client.submit(_probe_s, probe, common["mission"]["steps"] / short, pure=False)
                probes[kind] = [future]
    for kind, futures in probes.items():
        total += left[kind] * sum(client.gather(futures))
    return total / threads


def _probe_s(patterns: Mapping[str, Any], factor: float) -> float:
    fly_run(patterns, "probe")  # compiles, and warms the caches
    began = time.perf_counter()
    evaluate(fly_run(patterns, "probe"), 3)
    return (time.perf_counter() - began) * factor


def examples(plan: Plan, folder: Path, client: Any) -> dict[tuple[int, str], Evaluation]:
    """One mission of each of the plan's `shown` settings, with full recording, for the figures.

    Its seed is the trials' first, chosen before anything was flown. Without a client, those flown before.
    """
    spec = plan.campaigns["trials"]
    wanted = {trial_name(k, m): (k, m) for k, m in plan.shown}
    jobs = {wanted[job.group]: job for job in spec.jobs() if job.seed == spec.seeds[0] and job.group in wanted}
    places = {key: folder / "examples" / f"{key[0]}_auvs_{key[1]}" for key in jobs}
    flights = {
        key: client.submit(_example, job.patterns, f"example {job.group}", pure=False)
        for key, job in jobs.items()
        if client is not None and not places[key].exists()
    }
    found: dict[tuple[int, str], Evaluation] = {}
    for key, place in places.items():
        if key in flights:
            found[key] = flights[key].result()
            _keep(found[key], place)
        elif place.exists():
            found[key] = evaluate(bag.read_run(place, ground=_kept_ground(place / "ground.npz")))
    return found


def _keep(evaluation: Evaluation, place: Path) -> None:
    """Writes a run folder, which is there whole or not at all."""
    place.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".part-", dir=place.parent) as part:
        run = Path(part) / place.name
        bag.write_run(evaluation.run, run)
        _keep_ground(evaluation.run.ground, run / "ground.npz")
        write_outputs(evaluation, run)
        run.rename(place)


def _example(patterns: Mapping[str, Any], where: str) -> Evaluation:
    return evaluate(fly_run(patterns, where))


def _keep_ground(ground: GroundGrid | None, path: Path) -> None:
    import numpy as np

    if ground is not None:
        np.savez_compressed(
            path, north_m=ground.north_m, east_m=ground.east_m, depth_m=ground.depth_m, inside=ground.inside
        )


def _kept_ground(path: Path) -> GroundGrid | None:
    import numpy as np

    if not path.exists():
        return None
    with np.load(path) as kept:
        return GroundGrid(**{name: kept[name] for name in ("north_m", "east_m", "depth_m", "inside")})


def fly_plan(plan: Plan, folder: Path, client: Any) -> dict[str, Progress]:
    """Flies all campaigns of a plan; within a budget, each gets its share of the time that is left."""
    began = time.monotonic()
    states = {}
    for index, (name, spec) in enumerate(plan.flown.items()):
        left = plan.budget_s - (time.monotonic() - began)
        share = left * (0.8 if index == 0 and len(plan.flown) > 1 else 1.0)
        print(f"{name}: {len(spec.settings)} settings, {len(spec.seeds)} seeds", flush=True)
        with display() as show:
            states[name] = run_campaign(spec, folder / name, client, budget_s=share, progress=show)
        finish(spec, folder / name, states[name])
    return states


# Command line ---------------------------------------------------------------------------------------------------------


def parser() -> argparse.ArgumentParser:
    """The command line of scripts/reproduce."""
    p = argparse.ArgumentParser(
        prog="scripts/reproduce",
        description="Reproduces the paper's results in simulation: figures, a table over seeds with confidence "
        "intervals, and its claims, one by one, with what supports or contradicts them here. Can be interrupted; "
        "started again, it goes on where it stopped.",
    )
    p.add_argument("--quick", action="store_true", help="a small version, in about 3 minutes")
    p.add_argument("--out", type=Path, metavar="DIR", help="folder of results (default: runs/reproduce[-quick])")
    p.add_argument("--seeds", type=int, default=50, metavar="N", help="seeds of the field trials (default: 50)")
    p.add_argument("--sweep-seeds", type=int, default=10, metavar="N", help="seeds of the sensitivities (default: 10)")
    p.add_argument(
        "--sweep-methods",
        nargs="+",
        choices=METHODS,
        default=SENSITIVE,
        metavar="NAME",
        help=f"methods of the sensitivities (default: {' '.join(SENSITIVE)})",
    )
    p.add_argument(
        "--only",
        nargs="+",
        choices=("trials", "large", "sensitivity"),
        default=("trials", "large", "sensitivity"),
        help="campaigns to fly (default: all)",
    )
    add_cluster_options(p)
    p.add_argument("--estimate", action="store_true", help="say how long it will take, and end")
    p.add_argument("--page", action="store_true", help="write the page from the missions flown so far, and end")
    return p


#: Wall-clock time (s) that --quick gives to its missions; start, examples and page take the rest of its 3 minutes.
QUICK_S = 90.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Reproduces the paper. Returns 0; 1 if missions failed; 2 if it cannot be done; 130 after Ctrl-C."""
    from auv_lse_sim.campaign.reproduce_page import write_page

    began = time.monotonic()
    options = parser().parse_args(arguments)
    try:
        if options.seeds < 1 or options.sweep_seeds < 1:
            raise CampaignError(f"--seeds {options.seeds}, --sweep-seeds {options.sweep_seeds}: expected at least 1")
        plan = (
            quick_plan(QUICK_S)
            if options.quick
            else full_plan(options.seeds, options.sweep_seeds, options.only, options.sweep_methods)
        )
        folder = options.out or default_root() / ("reproduce-quick" if options.quick else "reproduce")
        folder.mkdir(parents=True, exist_ok=True)
        states: dict[str, Progress] = {}
        if options.page:
            shown = examples(plan, folder, None)
        else:
            with cluster(options.scheduler, options.workers) as client:
                threads = max(sum(client.nthreads().values()), 1)
                if not options.quick:
                    print("estimating the time", flush=True)
                    left = duration(estimate_s(plan, folder, client, threads))
                    print(f"about {left} on {threads} cores; Ctrl-C stops, the same command goes on", flush=True)
                    if options.estimate:
                        return 0
                states = fly_plan(plan, folder, client)
                shown = examples(plan, folder, client if "trials" in plan.only else None)
        page = write_page(plan, folder, shown)
    except (ParameterError, CampaignError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nstopped; finished missions are kept: the same command goes on from here", file=sys.stderr)
        return 130
    failed = sum(state.failed for state in states.values())
    print(f"{page} ({failed} missions failed; {duration(time.monotonic() - began)})")
    return 1 if failed else 0


__all__ = ["fly", "main"]

if __name__ == "__main__":
    sys.exit(main())
