"""What planner_node's diagnostics and log say about a planner."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from auv_lse_common.vocabulary.health import Health, Level
from auv_lse_planner.methods.decision import Decision
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner


def planner_health(planner: VehiclePlanner, problems: Mapping[str, str], planning_s: float) -> Health:
    """The state of a planner.

    Args:
        planner: The planner.
        problems: What `VehiclePlanner.problems` says now.
        planning_s: Wall clock that its last decision took (s).
    """
    values: dict[str, Any] = {"decisions": len(planner.records), "planning_ms": f"{1e3 * planning_s:.1f}"}
    if planner.records:
        last = planner.records[-1]
        values |= {"step": last.step, "iterations": last.iterations, "jbar": last.expected_end}
    level = Level.WARN if problems else Level.OK
    return Health(level=level, text="; ".join(problems.values()) or "ok", values=values)


def warnings_of(decision: Decision, deadline_s: float) -> list[str]:
    """What the log should say about a decision.

    Args:
        decision: The decision.
        deadline_s: The deadline that it had (s).
    """
    bound, found = decision.bound, []
    if bound.deadline_hit:
        found.append(
            f"step {bound.step}: the deadline of {deadline_s:g} s ended the search after {bound.iterations} "
            "iterations; the best plan so far is taken"
        )
    if decision.statistics.escape:
        found.append(f"step {bound.step}: nothing feasible; escaping, see docs/design/planner.md")
    return found
