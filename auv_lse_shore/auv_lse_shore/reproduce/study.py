"""The study that reproduces the paper: its settings and seeds.

Four campaigns: the field trials (teams of 2 and 3; the paper's two methods, the lawnmower and our own), the same with a
coarse chart as prior, the same in an area that three vehicles cannot cover completely, and sensitivities to one
parameter at a time.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auv_lse_run.shipped_files import shipped_file
from auv_lse_shore.campaign.spec import CampaignSpec

#: The project's own method.
OURS = "tour"

#: The methods compared: the paper's two, the lawnmower, and ours.
METHODS = ("augmented", "plain", "lawnmower", OURS)

#: The methods whose sensitivity is measured.
SENSITIVE = ("augmented", "plain", OURS)

#: The campaigns of a full study.
CAMPAIGNS = ("trials", "charted", "large", "sensitivity")

#: A coarse chart as prior: the paper's prior was not flat. The lakes' deviations from such charts have a standard
#: deviation of 3.8 to 4.9 m (seeds 8200 to 8205).
CHART: Mapping[str, Any] = {"sim.chart.smoothing_m": 75.0, "sim.chart.error_m": 2.5, "gp.signal_std_m": 5.0}

#: An area that three vehicles cannot cover in 100 steps: four times the field trial's.
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
        label: Name on the axis, with unit.
        points: Value on the axis, and the parameters that it stands for.
        default: The mission's default, simulated once for all sweeps; None where methods differ in it.
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


#: The sensitivities; each includes the default value.
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


SWEEP_NAMES = tuple(sweep.name for sweep in SWEEPS)


def trial_name(vehicles: int, method: str) -> str:
    """Name of a setting of the field trials."""
    return f"{vehicles} AUVs, {method}"


def sweep_name(sweep: Sweep, value: float, method: str) -> str:
    """Name of a setting of the sensitivities."""
    return f"default, {method}" if value == sweep.default else f"{sweep.name} {value:g}, {method}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """The missions of a reproduction of the paper.

    Attributes:
        name: "full" or "quick".
        campaigns: The campaigns, by name (of `CAMPAIGNS`), in order.
        sweeps: The sensitivities that the last one holds.
        teams: Team sizes of the trials.
        large_team: Team size in the large area.
        examples: Settings of the trials of which one mission is recorded for the figures: team size, method.
        budget_s: Time after which no further mission is started, over all campaigns.
        only: Names of the campaigns to simulate now; the page has all of them.
    """

    name: str
    campaigns: Mapping[str, CampaignSpec]
    sweeps: tuple[Sweep, ...]
    teams: tuple[int, ...]
    large_team: int
    examples: tuple[tuple[int, str], ...]
    budget_s: float
    only: tuple[str, ...] = CAMPAIGNS

    @property
    def selected(self) -> dict[str, CampaignSpec]:
        """The campaigns to simulate now."""
        return {name: spec for name, spec in self.campaigns.items() if name in self.only}


def base_mission() -> Path:
    """The default mission: the paper's field trial."""
    return shipped_file("missions/default.yaml")


def full_study(
    seeds: int,
    sweep_seeds: int,
    only: Sequence[str],
    sweep_methods: Sequence[str] = SENSITIVE,
    sweeps: Sequence[str] = SWEEP_NAMES,
) -> Study:
    """Everything: the trials over `seeds` seeds; chart, large area and sensitivities over fewer.

    Args:
        seeds: Seeds of the field trials.
        sweep_seeds: Seeds of the sensitivities.
        only: Names of the campaigns to simulate.
        sweep_methods: Methods of the sensitivities.
        sweeps: Names of the sensitivities.
    """
    trials = [{"label": trial_name(k, m), "mission.vehicles": k, "planner.method": m} for k in (2, 3) for m in METHODS]
    large = [{"label": trial_name(3, m), "mission.vehicles": 3, "planner.method": m} for m in METHODS]
    fewer = max(sweep_seeds, min(seeds, 20))
    chosen = [sweep for sweep in SWEEPS if sweep.name in sweeps]
    campaigns = {
        "trials": _spec("trials", trials, {}, seeds),
        "charted": _spec("charted", trials, CHART, fewer),
        "large": _spec("large", large, LARGE, fewer),
        "sensitivity": _spec("sensitivity", _swept(chosen, sweep_methods), {}, sweep_seeds),
    }
    return Study(
        name="full",
        campaigns=campaigns,
        only=tuple(only),
        sweeps=tuple(chosen),
        teams=(2, 3),
        large_team=3,
        examples=tuple((k, m) for k in (2, 3) for m in SENSITIVE),
        budget_s=float("inf"),
    )


def quick_study(budget_s: float) -> Study:
    """As many seeds of a small mission as the time allows, and three packet losses."""
    trials = [{"label": trial_name(k, m), "mission.vehicles": k, "planner.method": m} for k in (2, 3) for m in METHODS]
    sweeps = (_one("loss", "packets lost (share)", "sim.channel.packet_loss", [0.0, 0.5, 1.0], 0.0),)
    campaigns = {
        "trials": _spec("trials", trials, SMALL, 50),
        "sensitivity": _spec("sensitivity", _swept(sweeps, ("augmented",)), SMALL, 50),
    }
    return Study(
        name="quick",
        campaigns=campaigns,
        sweeps=sweeps,
        teams=(2, 3),
        large_team=3,
        examples=tuple((3, m) for m in SENSITIVE),
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
