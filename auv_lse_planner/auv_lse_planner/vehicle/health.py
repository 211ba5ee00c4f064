"""Texts and figures about a planner for planner_node's diagnostics and log."""

from collections.abc import Mapping
from typing import Any

from auv_lse_common.vocabulary.health import LEGS_PLANNED, Health, Level
from auv_lse_planner.methods.decision import Decision
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner


def planner_health(planner: VehiclePlanner, problems: Mapping[str, str], planning_s: float) -> Health:
    """The state of a planner.

    Args:
        problems: Its current problems (`VehiclePlanner.problems`).
        planning_s: Wall-clock duration of its last decision (s).
    """
    values: dict[str, Any] = {"decisions": len(planner.records), "planning_ms": f"{1e3 * planning_s:.1f}"}
    if planner.records:
        last = planner.records[-1]
        values[LEGS_PLANNED] = max(planner.rollout.steps - last.step, 0)
        values |= {"step": last.step, "iterations": last.iterations, "jbar": last.expected_end}
    level = Level.WARN if problems else Level.OK
    return Health(level=level, text="; ".join(problems.values()) or "ok", values=values)


def warnings_of(decision: Decision, deadline_s: float) -> list[str]:
    """Warnings to log about a decision."""
    bound, found = decision.bound, []
    if bound.deadline_hit:
        found.append(
            f"step {bound.step}: the deadline of {deadline_s:g} s ended the search after {bound.iterations} "
            "iterations; using the best plan so far"
        )
    if decision.statistics.escape:
        found.append(f"step {bound.step}: no action is feasible; escaping, see docs/design/planner.md")
    return found
