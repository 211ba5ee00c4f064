"""Sections `mission` and `motion`: parameters that all vehicles of a mission share."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from auv_lse_common.mission_file.parameters import ParameterError, configuration, is_given, parameter, section
from auv_lse_common.vocabulary.map_quality import Quality
from auv_lse_common.vocabulary.plan import MAX_ACTION_SET

#: The numbers that a vehicle takes from its file alone, by their key, in words: a default might not be the others'.
SHARED = {"vehicles": "the number of vehicles", "steps": "the number of steps of each vehicle"}


@configuration
class UntilConfig:
    """The quality at which a mission ends before its last step; omitted values are not required."""

    found: float | None = parameter(
        None,
        above=0.0,
        high=0.99,
        help="end early with this share found: length / (length + expected undiscovered)",
    )
    undiscovered_m: float | None = parameter(
        None, unit="m", above=0.0, high=1e6, help="and with this 95 % limit of the length undiscovered"
    )
    deviation_m: float | None = parameter(
        None, unit="m", above=0.0, high=1e3, help="and with 95 % of the line found expected within this"
    )

    @property
    def is_asked(self) -> bool:
        """Whether any quality is asked for."""
        return any(getattr(self, field.name) is not None for field in dataclasses.fields(self))

    def is_met(self, quality: Quality, share: float = 1.0) -> bool:
        """Whether a map has the quality asked for, or this share of it; False if nothing is asked for."""
        return self.is_asked and (
            (self.found is None or quality.found_share >= share * self.found)
            and (self.undiscovered_m is None or share * quality.undiscovered_m <= self.undiscovered_m)
            and (self.deviation_m is None or share * quality.deviation_m <= self.deviation_m)
        )

    @property
    def text(self) -> str:
        """The quality asked for, in words; "" if none is."""
        parts = []
        if self.found is not None:
            parts.append(f"{100.0 * self.found:g} % found")
        if self.undiscovered_m is not None:
            parts.append(f"at most {self.undiscovered_m:g} m undiscovered (with 95 % probability)")
        if self.deviation_m is not None:
            parts.append(f"95 % of the line found within {self.deviation_m:g} m")
        return ", ".join(parts)


@configuration
class MissionConfig:
    """Goal, size and seed of the mission, and the quality at which it ends."""

    goal: str = parameter(
        "chart",
        choices=("chart", "line"),
        help="'chart': classify every location; 'line': locate as much of the isobath as the legs allow; sets "
        "planner.method (docs/design/line.md)",
    )
    steps: int = parameter(100, low=1, high=65535, help="legs of each vehicle (paper: l)")
    seed: int = parameter(1, low=0, help="seed of every random stream of the mission")
    vehicles: int = parameter(3, low=1, high=20, help="number of vehicles (paper: K), numbered from 1")
    until: UntilConfig = dataclasses.field(default_factory=UntilConfig)


@configuration
class MotionConfig:
    """Motion primitives (paper, section 4): an arc at the turning radius, then a straight."""

    turn_radius_m: float = parameter(15.0, unit="m", above=0.0, high=1e3, help="turning radius (paper: r)")
    theta_max_deg: float = parameter(
        90.0, unit="deg", above=0.0, high=180.0, help="largest heading change (paper: theta_max)"
    )
    actions_deg: tuple[float, ...] = parameter(
        (-90.0, -30.0, -20.0, -10.0, -5.0, 0.0, 5.0, 10.0, 20.0, 30.0, 90.0),
        unit="deg",
        low=-180.0,
        high=180.0,
        help="heading changes to choose from (paper: A), positive clockwise",
    )
    straight: str = parameter(
        "constant",
        choices=("constant", "growing"),
        help="straight after a turn: 'constant' r (theta_max - |a|) makes all legs equally long; 'growing' r "
        "(theta_max + |a|) is the paper's",
    )
    straight_legs: bool | None = parameter(
        None,
        help="keep the straight line from each leg's start to its end free, too: autopilots travel it; left out: true "
        "if a vehicle has link.kind mavlink",
    )

    @property
    def leg_length_m(self) -> float:
        """Length of the straight-on leg; with `straight` 'constant', of every leg."""
        theta, turn = math.radians(self.theta_max_deg), math.radians(min(map(abs, self.actions_deg)))
        straight_m = self.turn_radius_m * (theta - turn if self.straight == "constant" else theta + turn)
        return self.turn_radius_m * turn + straight_m

    def with_straight_legs(self, has_autopilot: bool) -> MotionConfig:
        """This configuration with the default of `straight_legs` resolved: true with an autopilot."""
        return self if self.straight_legs is not None else dataclasses.replace(self, straight_legs=has_autopilot)

    def __post_init__(self) -> None:
        """Rejects unusable action sets.

        Raises:
            ValueError: naming the unusable actions.
        """
        if not self.actions_deg:
            raise ValueError("motion.actions_deg is empty; give at least one heading change (deg)")
        if len(self.actions_deg) > MAX_ACTION_SET:
            raise ValueError(
                f"motion.actions_deg has {len(self.actions_deg)} values; a packet has bytes for at most "
                f"{MAX_ACTION_SET}"
            )
        if len(set(self.actions_deg)) != len(self.actions_deg):
            raise ValueError(f"motion.actions_deg: {list(self.actions_deg)} repeats a heading change; give each once")
        largest = max(abs(a) for a in self.actions_deg)
        if largest > self.theta_max_deg:
            raise ValueError(
                f"motion.actions_deg: {largest:g} deg is larger than theta_max_deg ({self.theta_max_deg:g} deg)"
            )
        if min(self.actions_deg) >= 0.0 and max(self.actions_deg) <= 0.0:
            raise ValueError(
                f"motion.actions_deg: {list(self.actions_deg)} has no turn; a vehicle could not stay inside the area"
            )
        if len(self.actions_deg) == 1:
            raise ValueError(
                f"motion.actions_deg: {list(self.actions_deg)} is one turn; a vehicle would circle. Give another action"
            )


def shared_number(parameters: Mapping[str, Any], key: str, where: str) -> int:
    """`mission.vehicles` or `mission.steps` of a vehicle, which all vehicles must give alike: without default.

    Raises:
        ParameterError: if it is missing or not a whole number of at least 1.
    """
    mission = section(MissionConfig, parameters, "mission", where)
    if not is_given(parameters, f"mission.{key}"):
        raise ParameterError(
            f"{where}: mission.{key} is missing; all vehicles must share it. Add {SHARED[key]} to the mission file, "
            "section mission, under '/**:'"
        )
    value: int = getattr(mission, key)
    return value
