"""The parameters that docs/evidence/tuning.md shows, each at three values."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Knob:
    """A tunable parameter.

    Attributes:
        name: Short name, also of its picture.
        parameter: Its full name.
        values: A low value, about the default, a high value.
        unit: Unit, "" for none.
        method: The planning method.
        own_map: Whether to draw vehicle 1's own map instead of the team's, for parameters of the link.
    """

    name: str
    parameter: str
    values: tuple[float, float, float]
    unit: str = ""
    method: str = "tour"
    own_map: bool = False


KNOBS = (
    Knob(name="iterations", parameter="planner.iterations", values=(10, 150, 1000)),
    Knob(name="interval", parameter="planner.tour_interval", values=(1, 4, 30), unit="legs"),
    Knob(name="weight", parameter="planner.anytime_weight", values=(0.0, 1.0, 20.0)),
    Knob(name="horizon", parameter="planner.horizon", values=(1, 10, 30), unit="legs", method="plain"),
    Knob(name="exploration", parameter="planner.exploration", values=(0.0, 0.5, 5.0), method="plain"),
    Knob(name="spacing", parameter="gp.min_spacing_m", values=(2.0, 10.0, 60.0), unit="m"),
    Knob(name="length_scale", parameter="gp.length_scale_m", values=(15.0, 85.0, 400.0), unit="m"),
    Knob(name="slot", parameter="tdma.slot_s", values=(5.0, 10.0, 120.0), unit="s", own_map=True),
)


def shown(knob: Knob, value: float) -> str:
    """A value with its unit."""
    return f"{value:g} {knob.unit}".strip()
