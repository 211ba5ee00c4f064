"""A whole mission file, checked: every section of every package, for every vehicle.

The file is an ordinary ROS 2 parameter file. `/**:` holds for all, `/auv2/**:` for one vehicle. Only the sections of
`PER_VEHICLE` may stand under one vehicle: with different motion primitives or slots, vehicles could neither rebuild
each other's plans nor keep to their own slots.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from auv_lse_common.mission_file.parameters import (
    ParameterError,
    check_sections,
    merge,
    nest,
    parameters_for,
    read_parameter_file,
    section,
    to_mapping,
)
from auv_lse_common.mission_file.sections.acoustics import PacketConfig, TdmaConfig
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.mission_file.sections.mission import MissionConfig, MotionConfig
from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_common.mission_file.sections.places import PlacesConfig, in_force
from auv_lse_common.mission_file.sections.planner import PlannerConfig, PlannerSettings, check_planner
from auv_lse_common.mission_file.sections.record import RecordConfig
from auv_lse_common.mission_file.sections.safety import SafetyConfig
from auv_lse_common.mission_file.sections.sim import SimConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig, with_depth

#: Sections in which vehicles may differ.
PER_VEHICLE = ("vehicle", "safety", "planner", "gp", "modem", "link")

#: The class that checks each section of a mission file.
SECTION_CLASSES: dict[str, type] = {
    "mission": MissionConfig,
    "vehicle": VehicleConfig,
    "safety": SafetyConfig,
    "level_set": LevelSetConfig,
    "area": AreaConfig,
    "gp": GpConfig,
    "places": PlacesConfig,
    "motion": MotionConfig,
    "planner": PlannerConfig,
    "tdma": TdmaConfig,
    "packet": PacketConfig,
    "modem": ModemConfig,
    "link": LinkConfig,
    "sim": SimConfig,
    "record": RecordConfig,
}

#: A mission is stopped after this many times the time that its legs should take.
PATIENCE = 3.0

#: Patterns that match every node, as rcl reads them.
_FOR_ALL = ("/**", "**")
_ONE_VEHICLE = re.compile(r"/?auv(0|[1-9]\d*)/\*\*")
_VEHICLE_NAME = re.compile(r"auv(0|[1-9]\d*)")

Patterns = dict[str, dict[str, Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleSettings:
    """The sections that may differ between vehicles."""

    vehicle: VehicleConfig = field(default_factory=VehicleConfig)
    safety: SafetyConfig = field(default_factory=SafetyConfig)
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    gp: GpConfig = field(default_factory=GpConfig)
    modem: ModemConfig = field(default_factory=ModemConfig)
    link: LinkConfig = field(default_factory=LinkConfig)


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Everything that makes a mission.

    Attributes:
        where: The file it came from, for messages.
        mission, level_set, area, places, motion, tdma, packet, sim, record: Sections that hold for all.
        common: The sections of a vehicle that sets nothing of its own.
        vehicles: Each vehicle's own sections, by number from 1.
    """

    where: str = "settings"
    mission: MissionConfig = field(default_factory=MissionConfig)
    level_set: LevelSetConfig = field(default_factory=LevelSetConfig)
    area: AreaConfig = field(default_factory=AreaConfig)
    places: PlacesConfig = field(default_factory=PlacesConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    tdma: TdmaConfig = field(default_factory=TdmaConfig)
    packet: PacketConfig = field(default_factory=PacketConfig)
    sim: SimConfig = field(default_factory=SimConfig)
    record: RecordConfig = field(default_factory=RecordConfig)
    common: VehicleSettings = field(default_factory=VehicleSettings)
    vehicles: tuple[VehicleSettings, ...]

    @classmethod
    def load(cls, path: str | Path | None = None, overrides: Mapping[str, Any] | None = None) -> Settings:
        """Reads a mission file, or takes the defaults if there is none.

        Args:
            path: A ROS 2 parameter file.
            overrides: Values that win over the file, for all vehicles: dotted names ("mission.seed") or nested
                mappings. A name that begins with a vehicle ("auv2.vehicle.depth_m") is for that one.

        Raises:
            ParameterError: naming the key, the value, what was expected and the file.
        """
        patterns: Patterns = read_parameter_file(path) if path is not None else {"/**": {}}
        return cls.from_patterns(patterns, str(path) if path is not None else "defaults", overrides)

    @classmethod
    def from_patterns(
        cls, patterns: Mapping[str, Mapping[str, Any]], where: str, overrides: Mapping[str, Any] | None = None
    ) -> Settings:
        """The settings in what `read_parameter_file` returns."""
        on_top = _by_pattern(overrides or {})
        for_all = parameters_for({k: v for k, v in patterns.items() if k in _FOR_ALL}, "/settings")
        for_all = _overridden(for_all, on_top, None)
        mission = section(MissionConfig, for_all, "mission", where)
        for pattern, values in [*patterns.items(), *on_top]:
            _check_pattern(pattern, values, where, mission.vehicles)
        vehicles = []
        for number in range(1, mission.vehicles + 1):
            own = _overridden(parameters_for(patterns, f"/auv{number}/settings"), on_top, number)
            vehicles.append(_vehicle_settings(with_depth(own, number), f"{where} (auv{number})"))
            check_planner(mission, vehicles[-1].planner, f"{where} (auv{number})")
        return cls(
            where=where,
            mission=mission,
            level_set=section(LevelSetConfig, for_all, "level_set", where),
            area=section(AreaConfig, for_all, "area", where),
            places=section(PlacesConfig, for_all, "places", where),
            motion=section(MotionConfig, for_all, "motion", where),
            tdma=section(TdmaConfig, for_all, "tdma", where),
            packet=section(PacketConfig, for_all, "packet", where),
            sim=section(SimConfig, for_all, "sim", where),
            record=section(RecordConfig, for_all, "record", where),
            common=_vehicle_settings(for_all, where),
            vehicles=tuple(vehicles),
        )

    def with_overrides(self, overrides: Mapping[str, Any]) -> Settings:
        """These settings with other values, as `load` takes them."""
        return Settings.from_patterns(self.to_patterns(), self.where, overrides)

    def vehicle(self, number: int) -> VehicleSettings:
        """The sections of vehicle `number` (from 1).

        Raises:
            ValueError: if there is no such vehicle.
        """
        if not 1 <= number <= len(self.vehicles):
            raise ValueError(f"vehicle {number}: expected 1 to {len(self.vehicles)}")
        return self.vehicles[number - 1]

    def planner_settings(self, number: int) -> PlannerSettings:
        """The settings of the planner of vehicle `number`."""
        own, ideal = self.vehicle(number), self.sim.ideal or self.sim.navigation.ideal
        return PlannerSettings(
            mission=self.mission,
            level_set=self.level_set,
            area=self.area,
            gp=own.gp,
            motion=self.motion,
            planner=own.planner,
            vehicle=own.vehicle.without_surfacing() if own.link.kind == "mavlink" or ideal else own.vehicle,
        )

    def places_in_force(self, number: int) -> PlacesConfig:
        """The section `places` as vehicle `number` takes it: `correct` depends on its method where it is left out."""
        return in_force(self.places, {"planner": {"method": self.vehicle(number).planner.method}})

    @property
    def longest_s(self) -> float:
        """Mission time (s) after which a mission that has not finished is stopped."""
        leg = max(math.radians(self.motion.theta_max_deg) * self.motion.turn_radius_m * 2.0, 1.0)
        slowest = min(own.vehicle.speed_mps for own in self.vehicles)
        latest = max(own.vehicle.start_delay_s for own in self.vehicles)
        return latest + PATIENCE * self.mission.steps * leg / slowest + 600.0

    def parameters(self, number: int) -> dict[str, Any]:
        """The nested parameters that the nodes of vehicle `number` get."""
        return parameters_for(self.to_patterns(), f"/auv{number}/settings")

    def to_patterns(self) -> Patterns:
        """The complete mission file as nested mappings: every default filled in, the seed among them."""
        shared = ("mission", "level_set", "area", "places", "motion", "tdma", "packet", "sim", "record")
        for_all = {name: to_mapping(getattr(self, name)) for name in shared}
        common = {name: to_mapping(getattr(self.common, name)) for name in PER_VEHICLE}
        del common["vehicle"]["depth_m"]  # each vehicle's own, so that more vehicles take theirs in turn
        patterns: Patterns = {"/**": {**for_all, **common}}
        for number, own in enumerate(self.vehicles, 1):
            different: dict[str, Any] = {}
            for name in PER_VEHICLE:
                mine = to_mapping(getattr(own, name))
                values = {k: v for k, v in mine.items() if k not in common[name] or common[name][k] != v}
                if values:
                    different[name] = values
            if different:
                patterns[f"/auv{number}/**"] = different
        return patterns

    def to_parameter_file(self) -> str:
        """The complete mission file as text; it loads to equal settings."""
        lines = [
            "# A complete mission: every parameter is here, those left at their default too.",
            "# Read by ros2 run ... --params-file, the launch file, scripts/mission and the fleet engine alike.",
        ]
        body = {pattern: {"ros__parameters": _plain(values)} for pattern, values in self.to_patterns().items()}
        text: str = yaml.dump(body, Dumper=_Dumper, sort_keys=False, default_flow_style=False, width=110)
        return "\n".join([*lines, text])


class _Dumper(yaml.SafeDumper):  # type: ignore[misc]  # yaml has no types
    """Writes floats so that YAML 1.1 (and so ROS) reads them as floats: 1.0e-05, never 1e-05."""


def _float(dumper: yaml.SafeDumper, value: float) -> Any:
    text = repr(value)
    if "e" in text:
        mantissa, exponent = text.split("e")
        sign = exponent if exponent[0] in "+-" else "+" + exponent
        text = f"{mantissa if '.' in mantissa else mantissa + '.0'}e{sign}"
    return dumper.represent_scalar("tag:yaml.org,2002:float", text)


def _list(dumper: yaml.SafeDumper, value: list[Any]) -> Any:
    return dumper.represent_sequence("tag:yaml.org,2002:seq", value, flow_style=True)


_Dumper.add_representer(float, _float)
_Dumper.add_representer(list, _list)
_Dumper.ignore_aliases = lambda self, data: True  # ROS reads no YAML aliases


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value


def _vehicle_settings(parameters: Mapping[str, Any], where: str) -> VehicleSettings:
    return VehicleSettings(
        vehicle=section(VehicleConfig, parameters, "vehicle", where),
        safety=section(SafetyConfig, parameters, "safety", where),
        planner=section(PlannerConfig, parameters, "planner", where),
        gp=section(GpConfig, parameters, "gp", where),
        modem=section(ModemConfig, parameters, "modem", where),
        link=section(LinkConfig, parameters, "link", where),
    )


def _vehicle_of(pattern: str) -> int | None:
    """The vehicle whose nodes a pattern stands for, "/auv2/**"; None if it is not of that form."""
    match = _ONE_VEHICLE.fullmatch(pattern)
    return int(match[1]) if match else None


def _check_pattern(pattern: str, values: Mapping[str, Any], where: str, vehicles: int) -> None:
    """Refuses a pattern that matches no node of a mission, and sections that do not belong under it.

    A vehicle beyond `vehicles` is allowed: a smaller team may fly the file of a larger one.
    """
    number = _vehicle_of(pattern)
    if number is None and pattern not in _FOR_ALL:
        name = _VEHICLE_NAME.fullmatch(pattern.lstrip("/"))
        if name:
            raise ParameterError(
                f"{where}: {pattern}: matches only a node that is called {pattern}, and no mission has one; "
                f"expected '/auv{name[1]}/**' (every node of vehicle {name[1]})"
            )
        raise ParameterError(
            f"{where}: {pattern}: expected '/**' (all) or '/auv1/**' (one vehicle): a section means "
            "the same to every node"
        )
    if number == 0:
        raise ParameterError(f"{where}: {pattern}: vehicle 0; expected 1 to {vehicles}")
    nested = nest(values)
    check_sections(nested, f"{where}: {pattern}", ignore=("use_sim_time",))
    if number is not None:
        for name_of_section in nested:
            if name_of_section not in PER_VEHICLE:
                raise ParameterError(
                    f"{where}: {pattern}: {name_of_section}: the same for the whole team; expected under '/**' "
                    f"(vehicles may differ in {', '.join(PER_VEHICLE)})"
                )


def _by_pattern(overrides: Mapping[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """Overrides under the pattern that each stands for, in their order."""
    found: list[tuple[str, dict[str, Any]]] = []
    for name, values in _nested(overrides).items():
        vehicle = _VEHICLE_NAME.fullmatch(name)
        if vehicle is None:
            found.append(("/**", {name: values}))
        elif isinstance(values, Mapping):
            found.append((f"/{name}/**", dict(values)))
        else:
            raise ParameterError(f"{name}: got {values!r}; expected parameters of that vehicle, {name}.vehicle.depth_m")
    return found


def _overridden(
    parameters: Mapping[str, Any], on_top: Sequence[tuple[str, Mapping[str, Any]]], number: int | None
) -> dict[str, Any]:
    """Parameters with the overrides for all (and those of vehicle `number`) on top: a later one wins."""
    result = dict(parameters)
    for pattern, values in on_top:
        if pattern in _FOR_ALL or (number is not None and _vehicle_of(pattern) == number):
            result = merge(result, values)
    return result


def _nested(overrides: Mapping[str, Any]) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for name, value in overrides.items():
        result = merge(result, nest({name: _nested(value) if isinstance(value, Mapping) else value}))
    return result
