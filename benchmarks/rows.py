"""One line of the tables that `auv_lse bench` prints."""

from typing import Any

#: Content of a line; `auv_lse bench --json` writes these keys.
KEYS = ("name", "value", "unit", "against", "ratio", "goal", "holds")

Row = dict[str, Any]


def row(
    name: str,
    value: float | None,
    unit: str = "",
    against: str = "",
    ratio: float | None = None,
    goal: str = "",
    holds: bool | None = None,
) -> Row:
    """One measured figure.

    Args:
        value: The figure; None if it could not be measured.
        against: The alternative that it is compared with.
        ratio: How many times better than the alternative.
        goal: The goal, in words.
        holds: Whether it is; None without a goal.
    """
    return {
        "name": name,
        "value": None if value is None else float(value),
        "unit": unit,
        "against": against,
        "ratio": None if ratio is None else float(ratio),
        "goal": goal,
        "holds": None if holds is None else bool(holds),
    }
