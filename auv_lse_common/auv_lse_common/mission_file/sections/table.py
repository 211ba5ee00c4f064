"""The sections of a mission file, each with the dataclass that declares and checks its parameters.

This is the only list of sections: the loader, the parameter reference, the JSON schema and the template derive from it.
To add a section, write its dataclass and add a field here.
"""

import dataclasses
import difflib
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from auv_lse_common.mission_file.parameters import SECTIONS_OF, ParameterError, limits_of
from auv_lse_common.mission_file.retired import LIMITS, RENAMED
from auv_lse_common.mission_file.sections.acoustics import PacketConfig, TdmaConfig
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.mission_file.sections.mission import MissionConfig, MotionConfig
from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_common.mission_file.sections.positions import PositionsConfig
from auv_lse_common.mission_file.sections.record import RecordConfig
from auv_lse_common.mission_file.sections.safety import SafetyConfig
from auv_lse_common.mission_file.sections.sim import SimConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig


@dataclass(frozen=True, slots=True, kw_only=True)
class TeamSections:
    """The sections that are the same for all vehicles of a mission, under `/**:`."""

    mission: MissionConfig = field(default_factory=MissionConfig)
    level_set: LevelSetConfig = field(default_factory=LevelSetConfig)
    area: AreaConfig = field(default_factory=AreaConfig)
    positions: PositionsConfig = field(default_factory=PositionsConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    tdma: TdmaConfig = field(default_factory=TdmaConfig)
    packet: PacketConfig = field(default_factory=PacketConfig)
    sim: SimConfig = field(default_factory=SimConfig)
    record: RecordConfig = field(default_factory=RecordConfig)


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleSections:
    """The sections in which vehicles may differ, under `/**:` or `/auv2/**:`."""

    vehicle: VehicleConfig = field(default_factory=VehicleConfig)
    safety: SafetyConfig = field(default_factory=SafetyConfig)
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    gp: GpConfig = field(default_factory=GpConfig)
    modem: ModemConfig = field(default_factory=ModemConfig)
    link: LinkConfig = field(default_factory=LinkConfig)


#: The class of each section, by its name in the mission file.
TEAM_SECTIONS: dict[str, type] = typing.get_type_hints(TeamSections)
VEHICLE_SECTIONS: dict[str, type] = typing.get_type_hints(VehicleSections)
SECTIONS: dict[str, type] = {**TEAM_SECTIONS, **VEHICLE_SECTIONS}
for _name, _section in SECTIONS.items():
    LIMITS.update(limits_of(_section, f"{_name}."))
    for _field in dataclasses.fields(_section):
        SECTIONS_OF.setdefault(_field.name, []).append(_name)


def check_sections(parameters: Mapping[str, Any], where: str, ignore: Sequence[str] = ()) -> None:
    """Rejects unknown sections among the top-level names of `parameters`.

    Raises:
        ParameterError: naming the section and the most similar known one.
    """
    for name in parameters:
        if name not in SECTIONS and name not in ignore:
            renamed = {old.partition(".")[0]: new.partition(".")[0] for old, new in RENAMED.items()}
            if name in renamed:
                raise ParameterError(f"{where}: the section {name} is now called {renamed[name]}; rename it")
            near = difflib.get_close_matches(str(name), SECTIONS, n=1)
            hint = f"did you mean '{near[0]}'?" if near else f"known: {', '.join(SECTIONS)}"
            raise ParameterError(f"{where}: {name}: unknown section; {hint}")
