"""Parameters and values of earlier versions: recordings made with them remain readable, new mission files are refused.

`without_retired` rewrites the mission file of a recording for this version; `notes_on_retired` reports what it changes.
`parameters.py` names the replacement from here when it refuses one of them in a mission file.
"""

from collections.abc import Iterator, Mapping
from typing import Any

RETIRED = (
    "gp.local",
    "gp.outlier_sigmas",
    "gp.support_m",
    "level_set.method",
    "motion.track_spacing_m",
    "packet.check_limits",
    "packet.expected_loss",
    "packet.min_spacing_m",
    "packet.receivers",
    "packet.selection",
    "planner.batch",
    "planner.coordination",
    "planner.finalists",
    "planner.floor",
    "planner.lane_heading_deg",
    "planner.late_share",
    "planner.map_share",
    "planner.objective",
    "planner.own_area_m2",
    "planner.proposals",
    "planner.tail",
    "planner.team_order",
    "planner.team_routes",
)

#: Names of earlier versions, each with the name of today.
RENAMED: Mapping[str, str] = {
    "places.place_walk_m_rts": "positions.position_walk_m_rts",
    **{
        f"places.{key}": f"positions.{key}"
        for key in (
            "clock_drift_std_ppm",
            "clock_std_s",
            "correct",
            "fix_std_m",
            "harmonic_std_deg",
            "heading_std_deg",
            "heading_walk_deg_rth",
            "interval_s",
            "knot_s",
            "moved_m",
            "range_std_m",
            "scale_std",
            "sound_speed_mps",
            "sound_speed_std",
            "start_std_m",
            "terrain",
        )
    },
}

#: Values of earlier versions, by the parameter that took them, each with the value that replaced it.
RETIRED_VALUES: Mapping[str, Mapping[str, str]] = {
    "gp.kernel": {"matern32": "matern52", "wendland_c4": "wendland_c2"},
    "motion.straight": {"printed": "growing"},
    "planner.credit": {"printed": "whole"},
    "planner.method": {"best": "tour", "bounded": "tour", "map": "tour"},
}

#: The lowest and the highest value of each number, by its dotted name; `sections/table.py` enters them.
LIMITS: dict[str, tuple[float | None, float | None]] = {}


def replacement(name: str, value: Any) -> str | None:
    """The value that replaced a retired `value` of the parameter `name` ("planner.method"); None if it is not retired.

    Args:
        name: The dotted name; text before its section does not count ("my.yaml: planner.method").
    """
    known = RETIRED_VALUES.get(name.rpartition(": ")[2], {})
    return known.get(value) if isinstance(value, str) else None


def without_retired(patterns: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """A recording's mission file as this version reads it.

    Retired parameters are left out, renamed ones renamed, retired values replaced, and numbers beyond this version's
    limits become the limits.
    """
    return {pattern: _without_retired(values) for pattern, values in patterns.items()}


def notes_on_retired(patterns: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The changes by `without_retired`, one sentence for each kind; none for a file of this version."""
    found = [entry for values in patterns.values() for entry in _leaves(values)]
    gone = sorted({name for name, _ in found if name in RETIRED})
    replaced = sorted({(name, value) for name, value in found if replacement(name, value) is not None})
    limited = sorted({(name, value) for name, value in found if _limited(RENAMED.get(name, name), value) != value})
    notes = [
        f"Recorded by an earlier version with {name} {value!r}; this version reads it as {replacement(name, value)!r}."
        for name, value in replaced
    ]
    notes += [
        f"Recorded by an earlier version with {name} {value!r}; this version reads it as its limit, "
        f"{_limited(RENAMED.get(name, name), value)!r}."
        for name, value in limited
    ]
    if renamed := sorted({name for name, _ in found if name in RENAMED}):
        pairs = ", ".join(f"{name} (now {RENAMED[name]})" for name in renamed)
        notes.append(f"Recorded by an earlier version with parameters that have new names: {pairs}.")
    if gone:
        notes.append(f"Recorded by an earlier version with parameters that this version leaves out: {', '.join(gone)}.")
    return notes


def _without_retired(values: Mapping[str, Any], section: str = "") -> dict[str, Any]:
    """As `without_retired`, for the parameters of one pattern, or of a section with its dot ("planner.").

    A nested section keeps its nesting, also under its new name; dotted names stay dotted.
    """
    kept: dict[str, Any] = {}
    for key, value in values.items():
        name = f"{section}{key}"
        if isinstance(value, Mapping):
            for new_name, inner in _sections_of(name, _without_retired(value, f"{name}.")):
                kept[new_name] = {**kept.get(new_name, {}), **inner}
        elif name not in RETIRED:
            new = replacement(name, value)
            kept[RENAMED.get(name, key)] = _limited(RENAMED.get(name, name), value) if new is None else new
    return kept


def _limited(name: str, value: Any) -> Any:
    """A recorded value of the parameter `name`, or the limit that it exceeds."""
    low, high = LIMITS.get(name, (None, None))
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    if low is not None and value < low:
        return type(value)(low)
    return type(value)(high) if high is not None and value > high else value


def _sections_of(name: str, values: Mapping[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """The section `name` with its values; values with a new dotted name go to the section of that name."""
    moved = {key: value for key, value in values.items() if key in RENAMED.values()}
    stays = {key: value for key, value in values.items() if key not in moved}
    if stays or not moved:
        yield name.rpartition(".")[2], stays
    for key, value in moved.items():
        section, _, leaf = key.rpartition(".")
        yield section, {leaf: value}


def _leaves(values: Mapping[str, Any], section: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted name and value of each parameter."""
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{section}{key}.")
        else:
            yield f"{section}{key}", value
