"""Section `planner`, and the sections that a planner reads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Annotated, Any, Optional, TypeVar

from auv_lse_common.mission_file.goals import MAX_LINE_LEGS, with_method
from auv_lse_common.mission_file.methods import FAMILIES, METHODS, Family, MethodEntry
from auv_lse_common.mission_file.parameters import ParameterError, configuration, parameter, section
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.mission_file.sections.mission import MissionConfig, MotionConfig
from auv_lse_common.mission_file.sections.sim import SimConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig, with_depth
from auv_lse_common.vocabulary.naive_ids import LAWNMOWERS

if TYPE_CHECKING:
    _T = TypeVar("_T")
    FromMethod = Annotated[_T, "omitted: follows from the method"]
else:
    #: A parameter whose default (None) depends on the method; `PlannerConfig.complete` resolves it.
    FromMethod = Optional

#: Largest number of positions of a path that can be evaluated together; their covariance takes 0.5 GB.
MAX_LOCATIONS = 8000


def from_method(paper: Any, **options: Any) -> Any:
    """A parameter whose default depends on the method.

    Args:
        paper: Its value in the paper's augmented method, from which the other methods differ (`methods.py`).
    """
    declared = parameter(None, **options)
    return field(default=None, metadata={**declared.metadata, "paper": paper})


@configuration
class PlannerConfig:
    """Planning. Omitted parameters follow from the method."""

    method: str = parameter(
        "tour",
        choices=tuple(METHODS),
        help="planning method; sets every planner parameter that is left out (docs/design/planner.md)",
    )
    credit: FromMethod[str] = from_method(
        "whole",
        choices=("whole", "beyond"),
        help="benefit counted on this vehicle's path: 'whole' (the paper), or only 'beyond' what team mates' plans "
        "collect",
    )
    horizon: FromMethod[int] = from_method(3, low=1, high=200, help="planned legs (paper: m)")
    iterations: FromMethod[int] = from_method(
        100, low=1, high=1_000_000, help="tree search iterations for each decision"
    )
    augmented: FromMethod[bool] = from_method(
        True, help="continue the plan to the mission's end with a naive path (paper: augmented)"
    )
    naive_paths: FromMethod[tuple[int, ...]] = from_method(
        LAWNMOWERS[:1], low=0xE0, high=0xFE, help="ids of the naive paths to choose from (docs/reference/packet.md)"
    )
    incumbent: FromMethod[bool] = from_method(True, help="keep the last plan unless the new one has a higher value")
    exploration: FromMethod[float] = from_method(
        0.2, low=0.0, high=1e3, help="exploration constant of UCT, for values scaled to 0..1"
    )
    samples_per_leg: int = parameter(1, low=1, high=20, help="locations along each leg at which the reward is computed")
    lane_spacing_m: float = parameter(
        60.0, unit="m", above=0.0, high=10e3, help="distance between the lanes of a lawnmower"
    )
    map_spacing_m: float = parameter(
        20.0, unit="m", above=0.0, high=10e3, help="spacing of the positions over which the risk is summed"
    )
    anytime_weight: float = parameter(
        1.0, low=0.0, high=1e6, help="method tour: additional weight of an early drop of risk"
    )
    own_share: float = parameter(
        1.0,
        low=0.0,
        high=1e6,
        help="method tour: weight of the benefit at the next legs' positions",
    )
    tour_interval: FromMethod[int] = from_method(
        5, low=0, high=65535, unit="legs", help="method tour: legs between optimizations of the tour; 0: never"
    )
    deadline_s: float = parameter(
        2.0,
        unit="s",
        low=0.0,
        high=3600.0,
        help="wall-clock limit for a decision; 2.5 times as long for the first; 0: none; ignored in lockstep",
    )
    replan_lead_s: float = parameter(
        4.0, unit="s", low=0.0, high=3600.0, help="time before a leg's end at which the next leg is planned"
    )
    plan_expiry_s: float = parameter(
        600.0, unit="s", above=0.0, high=1e6, help="age at which a team mate's plan is discarded"
    )
    odometry_timeout_s: float = parameter(
        10.0, unit="s", above=0.0, high=1e6, help="age of odometry above which planning stops"
    )
    map_timeout_s: float = parameter(
        60.0, unit="s", above=0.0, high=1e6, help="age of the map above which it is a problem"
    )
    reanchor_m: float = parameter(
        10.0,
        unit="m",
        above=0.0,
        high=10e3,
        help="distance from the planned leg beyond which planning starts at the vehicle's position",
    )

    @property
    def family_name(self) -> str:
        """Name of the method's family, see `methods.FAMILIES`."""
        return self.entry.family

    @property
    def family(self) -> Family:
        """Properties of the method's family."""
        return FAMILIES[self.family_name]

    @property
    def entry(self) -> MethodEntry:
        """The method's entry in the table of methods."""
        return METHODS[self.method]

    def complete(self) -> PlannerConfig:
        """This configuration with the method's values for omitted parameters: no `FromMethod` parameter is None."""
        paper = {f.name: f.metadata["paper"] for f in fields(self) if "paper" in f.metadata}
        values = {**paper, **self.entry.parameters}
        values |= {name: value for name in paper if (value := getattr(self, name)) is not None}
        if values["augmented"] and not values["naive_paths"]:
            values["naive_paths"] = paper["naive_paths"]
        if not values["augmented"] and self.family_name != "naive":
            values["naive_paths"] = ()
        return replace(self, **values)


def check_planner(mission: MissionConfig, planner: PlannerConfig, where: str) -> None:
    """Rejects missions with too many positions to evaluate together.

    Raises:
        ParameterError: naming the largest number of steps that the method can plan.
    """
    complete = planner.complete()
    if complete.family.bound_of == "line" and mission.steps > MAX_LINE_LEGS:
        raise ParameterError(
            f"{where}: mission.steps is {mission.steps}, but planner.method {planner.method!r} plans at most "
            f"{MAX_LINE_LEGS} legs. Split the mission, or set planner.method to tour or plain."
        )
    each = max(complete.family.positions_per_leg, complete.samples_per_leg)
    positions = mission.steps * each
    if positions > MAX_LOCATIONS and (complete.augmented or complete.family.to_the_end):
        raise ParameterError(
            f"{where}: mission.steps: {mission.steps} steps are too many for planner.method {planner.method!r}: "
            f"the covariances of {positions} positions would need {8e-9 * positions**2:.0f} GB. Use at most "
            f"{MAX_LOCATIONS // each} steps, or planner.method plain, which plans only a few legs ahead"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerSettings:
    """The sections that a planner reads."""

    mission: MissionConfig = field(default_factory=MissionConfig)
    level_set: LevelSetConfig = field(default_factory=LevelSetConfig)
    area: AreaConfig
    gp: GpConfig = field(default_factory=GpConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    vehicle: VehicleConfig = field(default_factory=VehicleConfig)

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any], where: str, vehicle: int | None = None) -> PlannerSettings:
        """The settings from a nested parameter mapping.

        Args:
            vehicle: Number of the vehicle, from 1, for its default depth (`DEPTHS_M`); None: the section's default.

        Raises:
            ParameterError: naming the key, the value, what was expected and `where`.
        """
        parameters = with_method(parameters)
        if vehicle is not None:
            parameters = with_depth(parameters, vehicle)
        mission = section(MissionConfig, parameters, "mission", where)
        planner = section(PlannerConfig, parameters, "planner", where)
        check_planner(mission, planner, where)
        vehicle_config = section(VehicleConfig, parameters, "vehicle", where)
        sim = section(SimConfig, parameters, "sim", where)
        has_autopilot = section(LinkConfig, parameters, "link", where).kind == "mavlink"
        if has_autopilot or sim.ideal or sim.navigation.ideal:
            vehicle_config = vehicle_config.without_surfacing()
        motion = section(MotionConfig, parameters, "motion", where)
        return cls(
            mission=mission,
            level_set=section(LevelSetConfig, parameters, "level_set", where),
            area=section(AreaConfig, parameters, "area", where),
            gp=section(GpConfig, parameters, "gp", where),
            motion=motion.with_straight_legs(has_autopilot),
            planner=planner,
            vehicle=vehicle_config,
        )
