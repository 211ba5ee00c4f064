"""What gp_node's diagnostics say about a map."""

from __future__ import annotations

from collections.abc import Mapping

from auv_lse_common.vocabulary.health import Health, Level
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.places.position_corrector import PositionCorrector

#: After this time (s) without an own sounding it is told.
QUIET_S = 60.0


def map_totals(depth_map: DepthMap, gated: Mapping[str, int]) -> dict[str, int]:
    """What counts against a map so far: soundings refused and given up, samples that do not fit, by name.

    Args:
        depth_map: The map.
        gated: Own soundings that the gate has refused, by kind.
    """
    counts = depth_map.counts
    return {
        "refused": counts.refused,
        "full": counts.full,
        **{f"soundings {kind}": number for kind, number in gated.items()},
        **{f"outliers of auv{k}": mate.outliers for k, mate in sorted(depth_map.team.items())},
    }


def map_health(
    depth_map: DepthMap,
    update_s: float,
    field_s: float,
    gated: Mapping[str, int],
    recent: Mapping[str, int],
    corrector: PositionCorrector | None = None,
    quiet_s: float = 0.0,
) -> Health:
    """The state of a map: it warns of what was counted lately, and tells what was counted in all.

    Args:
        depth_map: The map.
        update_s: Wall clock that its last update took (s).
        field_s: Wall clock that field and isobath took (s).
        gated: Own soundings that the gate has refused, by kind.
        recent: By how much `map_totals` have grown lately (`Recent`).
        corrector: What corrects the places of its soundings, if anything does.
        quiet_s: Time without an own sounding (s).
    """
    counts = depth_map.counts
    values = {
        "centers": len(depth_map.gp),
        "kept": counts.kept,
        "too_close": counts.too_close,
        "merged": counts.merged,
        "outliers": counts.outliers,
        "full": counts.full,
        "refused": counts.refused,
        "last_refused": depth_map.last_problem,
        "update_ms": f"{1e3 * update_s:.2f}",
        "map_ms": f"{1e3 * field_s:.2f}",
    }
    if corrector is not None and corrector.correction is not None:
        values |= {
            "places corrected at": f"{corrector.correction.stamp_s:.0f} s",
            "map made again": corrector.rebuilds,
            "ranges": len(corrector.smoother.ranges),
            "ranges and fixes refused": corrector.correction.refused,
            "navigation refused": corrector.smoother.refused,
        }
    values |= {f"samples of auv{k} that do not fit": f"{m.outliers} of {m.heard}" for k, m in depth_map.team.items()}
    values |= {f"soundings {kind}": number for kind, number in gated.items()}
    level, text = _verdict(depth_map, gated, recent, quiet_s)
    return Health(level=level, text=text, values=values)


def _verdict(
    depth_map: DepthMap, gated: Mapping[str, int], recent: Mapping[str, int], quiet_s: float
) -> tuple[Level, str]:
    team = sorted(depth_map.team.items())
    suspicious = [f"auv{k}" for k, mate in team if mate.suspicious and recent.get(f"outliers of auv{k}")]
    if suspicious:
        who = ", ".join(suspicious)
        return Level.WARN, f"samples of {who} do not fit the own map: its place, its sensor, or a forger?"
    counts, most = depth_map.counts, depth_map.gp.config.max_centers
    if recent.get("full"):
        return Level.WARN, f"{counts.full} soundings given up: the map has gp.max_centers = {most}"
    if new := recent.get("refused"):
        return Level.WARN, f"{new} soundings refused lately, {counts.refused} in all: {depth_map.last_problem}"
    kinds = [
        f"{new} {kind} ({total} in all)"
        for kind, total in sorted(gated.items())
        if (new := recent.get(f"soundings {kind}"))
    ]
    if kinds:
        return Level.WARN, f"own soundings refused lately: {', '.join(kinds)}"
    if quiet_s > QUIET_S:
        return Level.WARN, f"no own sounding for {quiet_s:.0f} s: no echo, or a sounder that is silent?"
    return Level.OK, "ok"
