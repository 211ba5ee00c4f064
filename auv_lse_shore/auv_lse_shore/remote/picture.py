"""The laptop's knowledge of each vehicle, its age, and the expected position under water. Pure: times are arguments.

A state's age counts from the moment the laptop asked for it, plus the age that the vehicle reported. So it is never
older than shown, whatever the link did, and no clocks are compared.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from auv_lse_shore.remote.judge import ill_health, running_problems

#: Depth (m) below which a vehicle has no Wi-Fi.
SURFACE_M = 0.7
#: Time (s) without an answer after which a vehicle at the surface is silent.
SILENT_S = 30.0


@dataclass(slots=True)
class VehicleView:
    """The laptop's knowledge of one vehicle.

    Attributes:
        name: "auv2".
        answer: The last state; empty: none yet.
        asked_s: When it was asked for, by a steady clock (s).
        trouble: Why there is no newer one; "" if the last question was answered.
    """

    name: str
    answer: Mapping[str, Any] = field(default_factory=dict)
    asked_s: float = -math.inf
    trouble: str = ""
    laptop: str = ""

    def part(self, name: str) -> Mapping[str, Any]:
        """A part of the state: "mission", "position", "autopilot", "path"; empty if it is not known."""
        found: Mapping[str, Any] = (self.answer.get("state") or {}).get(name) or {}
        return found

    def age_s(self, name: str, now_s: float) -> float | None:
        """Upper bound (s) of the age of a part; None: unknown."""
        own = self.part(name).get("age_s")
        return None if own is None else now_s - self.asked_s + float(own)

    @property
    def state(self) -> str:
        """The mission's state in words."""
        if not self.answer:
            return "no answer"
        if not self.answer.get("running"):
            return "nodes do not run"
        return str(self.part("mission").get("state", "?"))

    def is_under_water(self) -> bool:
        """Whether it was below the surface when it was last heard, or was about to be."""
        depth_m = self.part("position").get("depth_m")
        return (depth_m is not None and depth_m > SURFACE_M) or self.state == "RUNNING"

    def position(self, now_s: float) -> tuple[float, float, bool] | None:
        """North, east (m), and whether that is expected rather than reported; None: unknown."""
        position = self.part("position")
        north_m, east_m = position.get("north_m"), position.get("east_m")
        if north_m is None or east_m is None:
            return None
        age_s = self.age_s("position", now_s)
        if not self.trouble or age_s is None or self.state != "RUNNING":
            return north_m, east_m, False
        path = self.part("path").get("north_east_m") or []
        distance_m = max(float(position.get("speed_mps") or 0.0), 0.0) * age_s
        return (*expected_position((north_m, east_m), path, distance_m), True)

    def alarms(self, now_s: float) -> list[str]:
        """Sentences that an operator must see."""
        found = []
        if self.trouble and (now_s - self.asked_s > SILENT_S):
            if not self.answer:
                found.append(self.trouble)
            elif not self.is_under_water():
                found.append(f"silent at the surface: {self.trouble}")
        if self.answer.get("running") and not self.trouble:
            found += [text for level, text in running_problems(self.answer.get("state") or {}, 0.0) if level == "error"]
            found += [*self.part("mission").get("warnings", ()), *ill_health(self.answer.get("state") or {})]
        if self.state == "ABORTED":
            found.append(f"ABORTED: {self.part('mission').get('reason', '')}")
        by = self.answer.get("controller") or {}
        if by and self.laptop and by["laptop"] != self.laptop:
            found.append(f"{by['name']} has commanded it since {by['at']}")
        return found


def expected_position(
    start: tuple[float, float], path: Sequence[Sequence[float]], distance_m: float
) -> tuple[float, float]:
    """North, east (m) after travelling a distance along a path, from its corner nearest to the start on.

    Args:
        start: North, east (m).
        path: North, east (m) of its corners.
        distance_m: Distance to travel (m); it ends at the path's end.
    """
    if not path:
        return start
    nearest = min(range(len(path)), key=lambda k: math.dist(start, path[k]))
    at = start
    for corner in path[nearest + 1 :]:
        leg_m = math.dist(at, corner)
        if leg_m >= distance_m:
            share = distance_m / leg_m if leg_m else 0.0
            return at[0] + share * (corner[0] - at[0]), at[1] + share * (corner[1] - at[1])
        distance_m -= leg_m
        at = (corner[0], corner[1])
    return at
