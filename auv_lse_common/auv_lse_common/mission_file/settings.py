"""A whole mission file: every section for every vehicle, checked.

The file is a ROS 2 parameter file. `/**:` applies to all vehicles, `/auv2/**:` to one. Only the sections of
`VehicleSections` may be set for one vehicle: with different motion primitives or slots, vehicles could neither rebuild
each other's plans nor keep their slots.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.degrees import AreaReader, with_area_file
from auv_lse_common.mission_file.goals import finds_method, with_method
from auv_lse_common.mission_file.parameter_file import parameter_text, parameters_for, read_parameter_file
from auv_lse_common.mission_file.parameters import ParameterError, merge, nest, section, to_mapping
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.link import LinkConfig, check_origin
from auv_lse_common.mission_file.sections.mission import SHARED, MissionConfig, shared_number
from auv_lse_common.mission_file.sections.planner import PlannerSettings, check_planner
from auv_lse_common.mission_file.sections.positions import PositionsConfig, in_force
from auv_lse_common.mission_file.sections.table import (
    SECTIONS,
    TEAM_SECTIONS,
    VEHICLE_SECTIONS,
    TeamSections,
    VehicleSections,
    check_sections,
)
from auv_lse_common.mission_file.sections.vehicle import with_depth

#: A mission is stopped after this multiple of the expected duration of its legs.
PATIENCE = 3.0

#: Patterns that match every node in rcl.
_ALL_NODES = ("/**", "**")
_ONE_VEHICLE = re.compile(r"/?auv(0|[1-9]\d*)/\*\*")
_VEHICLE_NAME = re.compile(r"auv(0|[1-9]\d*)")

Patterns = dict[str, dict[str, Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings(TeamSections):
    """A mission: the sections of the whole team, and those of each vehicle.

    Attributes:
        common: The sections of a vehicle without parameters of its own.
        vehicles: Each vehicle's sections, in order of their numbers from 1.
        finds_method: Whether the planning method follows from the goal `line`, the team and the area, and so may change
            with them.
    """

    where: str = "settings"
    common: VehicleSections = field(default_factory=VehicleSections)
    vehicles: tuple[VehicleSections, ...]
    finds_method: bool = field(default=False, compare=False)

    @classmethod
    def load(
        cls,
        path: str | Path | None = None,
        overrides: Mapping[str, Any] | None = None,
        read_area: AreaReader | None = None,
    ) -> Settings:
        """Reads a mission file; without one, uses the defaults.

        Args:
            overrides: Values that replace the file's: dotted names ("mission.seed") or nested mappings. A name that
                begins with a vehicle ("auv2.vehicle.depth_m") applies to that vehicle only.
            read_area: Reads the file that `area.file` names; None: such a file is refused.

        Raises:
            ParameterError: naming the key, the value, what was expected and the file.
        """
        origin = origin_of(overrides or {})
        patterns: Patterns = {"/**": {}}
        if path is not None:
            patterns = read_parameter_file(path, read_area, origin_on_top=origin)
        if overrides and "area.file" in overrides:
            overrides = dict(overrides)
            patterns = with_area_file(patterns, str(overrides.pop("area.file")), read_area, origin)
        return cls.from_patterns(patterns, str(path) if path is not None else "defaults", overrides)

    @classmethod
    def from_patterns(
        cls, patterns: Mapping[str, Mapping[str, Any]], where: str, overrides: Mapping[str, Any] | None = None
    ) -> Settings:
        """The settings from the result of `read_parameter_file`; other arguments as in `load`."""
        on_top = by_pattern(overrides or {})
        for_all = parameters_for({k: v for k, v in patterns.items() if k in _ALL_NODES}, "/settings")
        given = [overridden(for_all, on_top, None)]
        for_all = with_method(given[0])
        mission = section(MissionConfig, for_all, "mission", where)
        for pattern, values in [*patterns.items(), *on_top]:
            check_pattern(pattern, values, where, mission.vehicles)
        vehicles = []
        for number in range(1, mission.vehicles + 1):
            given.append(overridden(parameters_for(patterns, f"/auv{number}/settings"), on_top, number))
            own = with_method(given[-1], for_all)
            vehicles.append(_vehicle_sections(with_depth(own, number), f"{where} (auv{number})"))
            check_planner(mission, vehicles[-1].planner, f"{where} (auv{number})")
        team: dict[str, Any] = {name: section(kind, for_all, name, where) for name, kind in TEAM_SECTIONS.items()}
        has_autopilot = any(own.link.kind == "mavlink" for own in vehicles)
        team["motion"] = team["motion"].with_straight_legs(has_autopilot)  # the same for all: they rebuild plans
        team["sim"] = team["sim"].in_area(team["area"].polygon_m)
        team["finds_method"] = finds_method(mission.goal, given)
        return cls(where=where, common=_vehicle_sections(for_all, where), vehicles=tuple(vehicles), **team)

    def check_origin(self) -> None:
        """Rejects missions of autopilots in an area without an origin, once the ground has been asked for one.

        Raises:
            ParameterError: naming the vehicle and the keys.
        """
        for number, own in enumerate(self.vehicles, 1):
            check_origin(own.link, self.area, f"{self.where} (auv{number})")

    def with_overrides(self, overrides: Mapping[str, Any]) -> Settings:
        """These settings with `overrides` as in `load`."""
        return Settings.from_patterns(self.open_patterns(), self.where, overrides)

    def vehicle(self, number: int) -> VehicleSections:
        """The sections of vehicle `number` (from 1).

        Raises:
            ValueError: if there is no such vehicle.
        """
        if not 1 <= number <= len(self.vehicles):
            raise ValueError(f"vehicle {number} does not exist; the mission has vehicles 1 to {len(self.vehicles)}")
        return self.vehicles[number - 1]

    def planner_settings(self, number: int) -> PlannerSettings:
        """The planner settings of vehicle `number`."""
        return PlannerSettings.from_parameters(self.parameters(number), self.where, number)

    def positions_in_force(self, number: int) -> PositionsConfig:
        """The section `positions` of vehicle `number`, with the default of `correct` resolved by its method."""
        return in_force(self.positions, {"planner": {"method": self.vehicle(number).planner.method}})

    @property
    def longest_s(self) -> float:
        """Mission time (s) after which an unfinished mission is stopped."""
        leg = max(math.radians(self.motion.theta_max_deg) * self.motion.turn_radius_m * 2.0, 1.0)
        slowest = min(own.vehicle.speed_mps for own in self.vehicles)
        latest = max(own.vehicle.start_delay_s for own in self.vehicles)
        return latest + PATIENCE * self.mission.steps * leg / slowest + 600.0

    def parameters(self, number: int) -> dict[str, Any]:
        """The nested parameters of the nodes of vehicle `number`."""
        return parameters_for(self.to_patterns(), f"/auv{number}/settings")

    def to_patterns(self) -> Patterns:
        """The complete mission file as nested mappings, with every default filled in."""
        for_all = {name: to_mapping(getattr(self, name)) for name in TEAM_SECTIONS}
        common = {name: to_mapping(getattr(self.common, name)) for name in VEHICLE_SECTIONS}
        del common["vehicle"]["depth_m"]  # differs by vehicle, also in a larger team
        patterns: Patterns = {"/**": {**for_all, **common}}
        for number, own in enumerate(self.vehicles, 1):
            different: dict[str, Any] = {}
            for name in VEHICLE_SECTIONS:
                mine = to_mapping(getattr(own, name))
                values = {k: v for k, v in mine.items() if k not in common[name] or common[name][k] != v}
                if values:
                    different[name] = values
            if different:
                patterns[f"/auv{number}/**"] = different
        return patterns

    def open_patterns(self) -> Patterns:
        """Like `to_patterns`, but without a planning method that follows from the rest (`finds_method`)."""
        patterns = self.to_patterns()
        if self.finds_method:
            del patterns["/**"]["planner"]["method"]
        return patterns

    def to_parameter_file(self) -> str:
        """The complete mission file as text, from which `load` makes equal settings."""
        lines = [
            "# A complete mission: every parameter with its value, defaults included.",
            "# Accepted by ros2 run --ros-args --params-file, the launch files and auv_lse mission.",
        ]
        return "\n".join([*lines, parameter_text(self.to_patterns())])


def _vehicle_sections(parameters: Mapping[str, Any], where: str) -> VehicleSections:
    own: dict[str, Any] = {name: section(kind, parameters, name, where) for name, kind in VEHICLE_SECTIONS.items()}
    return VehicleSections(**own)


def _vehicle_of(pattern: str) -> int | None:
    """The vehicle of a pattern like "/auv2/**"; None for other patterns."""
    match = _ONE_VEHICLE.fullmatch(pattern)
    return int(match[1]) if match else None


def check_pattern(pattern: str, values: Mapping[str, Any], where: str, vehicles: int) -> int | None:
    """Rejects a pattern that matches no node of a mission, and sections that are invalid for it.

    A vehicle beyond `vehicles` is allowed, so that a smaller team can use the file of a larger one.

    Returns:
        The pattern's vehicle; None for all vehicles.

    Raises:
        ParameterError: naming the pattern, or the section.
    """
    number = _vehicle_of(pattern)
    if number is None and pattern not in _ALL_NODES:
        name = _VEHICLE_NAME.fullmatch(pattern.lstrip("/"))
        if name:
            raise ParameterError(
                f"{where}: {pattern} matches only a node with the name {pattern}; write '/auv{name[1]}/**', "
                f"which matches every node of vehicle {name[1]}"
            )
        raise ParameterError(
            f"{where}: {pattern} matches no vehicle; write '/**' (all vehicles) or a pattern such as '/auv1/**'"
        )
    if number == 0:
        raise ParameterError(f"{where}: {pattern}: there is no vehicle 0; the mission has vehicles 1 to {vehicles}")
    nested = nest(values)
    check_sections(nested, f"{where}: {pattern}", ignore=("use_sim_time",))
    if number is not None:
        for name_of_section in nested:
            if name_of_section not in VEHICLE_SECTIONS:
                raise ParameterError(
                    f"{where}: {pattern}: {name_of_section} is the same for the whole team; move it to '/**' "
                    f"(vehicles may differ in {', '.join(VEHICLE_SECTIONS)})"
                )
    return number


def check_vehicle(patterns: Mapping[str, Mapping[str, Any]], where: str, number: int, nodes: Iterable[str]) -> None:
    """Rejects parameters that a node of vehicle `number` would refuse, also those for one node ("/auv2/gp_node").

    Raises:
        ParameterError: naming the key, the value, what was expected and `where`.
    """
    where = f"{where} (auv{number})"
    for node in ("settings", *nodes):
        own = parameters_for(patterns, f"/auv{number}/{node}")
        for name, kind in SECTIONS.items():
            section(kind, with_depth(with_method(own), number), name, where)
        PlannerSettings.from_parameters(own, where, number)
        check_origin(section(LinkConfig, own, "link", where), section(AreaConfig, own, "area", where), where)
        for key in SHARED:
            shared_number(own, key, where)


def beyond_team(pattern: str, vehicles: int, where: str) -> str:
    """A note that a pattern's parameters are ignored, because its vehicle is beyond the team; "" if it is not."""
    number = _vehicle_of(pattern)
    if number is None or number <= vehicles:
        return ""
    return (
        f"{where}: {pattern}: there is no vehicle {number}, because mission.vehicles is {vehicles}. These parameters "
        "are ignored"
    )


def by_pattern(overrides: Mapping[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """Overrides with the node pattern of each, in their order."""
    found: list[tuple[str, dict[str, Any]]] = []
    for name, values in _nested(overrides).items():
        if _VEHICLE_NAME.fullmatch(name) is None:
            found.append(("/**", {name: values}))
        elif isinstance(values, Mapping):
            found.append((f"/{name}/**", dict(values)))
        else:
            raise ParameterError(f"{name} must hold parameters, such as {name}.vehicle.depth_m, not {values!r}")
    return found


def overridden(
    parameters: Mapping[str, Any], on_top: Sequence[tuple[str, Mapping[str, Any]]], number: int | None
) -> dict[str, Any]:
    """Parameters with the overrides for all vehicles and for vehicle `number`; later ones replace earlier ones."""
    result = dict(parameters)
    for pattern, values in on_top:
        if pattern in _ALL_NODES or (number is not None and _vehicle_of(pattern) == number):
            result = merge(result, values)
    return result


def origin_of(overrides: Mapping[str, Any]) -> dict[str, Any]:
    """The origin among overrides: degrees are converted about it."""
    area = _nested(overrides).get("area")
    return {k: v for k, v in area.items() if k.startswith("origin_")} if isinstance(area, Mapping) else {}


def _nested(overrides: Mapping[str, Any]) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for name, value in overrides.items():
        result = merge(result, nest({name: _nested(value) if isinstance(value, Mapping) else value}))
    return result
