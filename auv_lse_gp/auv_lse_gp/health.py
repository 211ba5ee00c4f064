"""Diagnostics of gp_node."""

from collections.abc import Mapping

from auv_lse_common.support.plurals import counted
from auv_lse_common.vocabulary.health import Health, Level
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.positions.position_corrector import PositionCorrector

#: Warn after this time (s) without a sounding of this vehicle.
QUIET_S = 60.0


def map_totals(depth_map: DepthMap, gated: Mapping[str, int]) -> dict[str, int]:
    """Total numbers of problems by name: rejected or discarded soundings, samples that do not fit.

    Args:
        gated: Number of own soundings rejected by the gate, by kind.
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
    """Health of a map: warns of recent problems and lists total numbers.

    Args:
        update_s: Wall-clock time of its last update (s).
        field_s: Wall-clock time of the last field and isobath (s).
        recent: Recent increase of the `map_totals` (`Recent`).
        quiet_s: Time without a sounding of this vehicle (s).
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
            "positions corrected at": f"{corrector.correction.stamp_s:.0f} s",
            "map rebuilds": corrector.rebuilds,
            "ranges": len(corrector.smoother.ranges),
            "ranges and fixes refused": corrector.correction.refused,
            "navigation refused": corrector.smoother.refused,
        }
    values |= {f"samples of auv{k} that do not fit": f"{m.outliers} of {m.heard}" for k, m in depth_map.team.items()}
    values |= {f"soundings {kind}": number for kind, number in gated.items()}
    level, text = _level_and_text(depth_map, gated, recent, quiet_s)
    return Health(level=level, text=text, values=values)


def _level_and_text(
    depth_map: DepthMap, gated: Mapping[str, int], recent: Mapping[str, int], quiet_s: float
) -> tuple[Level, str]:
    team = sorted(depth_map.team.items())
    suspicious = [f"auv{k}" for k, mate in team if mate.suspicious and recent.get(f"outliers of auv{k}")]
    if suspicious:
        who = ", ".join(suspicious)
        return Level.WARN, f"samples of {who} do not fit this vehicle's map: wrong position, bad sensor, or forged?"
    counts, most = depth_map.counts, depth_map.gp.config.max_centers
    if recent.get("full"):
        return Level.WARN, f"{counted(counts.full, 'sounding')} discarded: the map is full (gp.max_centers = {most})"
    if new := recent.get("refused"):
        return (
            Level.WARN,
            f"{counted(new, 'sounding')} refused recently, {counts.refused} in total: {depth_map.last_problem}",
        )
    kinds = [
        f"{new} {kind} ({total} in total)"
        for kind, total in sorted(gated.items())
        if (new := recent.get(f"soundings {kind}"))
    ]
    if kinds:
        return Level.WARN, f"own soundings rejected recently: {', '.join(kinds)}"
    if quiet_s > QUIET_S:
        return Level.WARN, f"no own sounding for {quiet_s:.0f} s: no echo, or a silent sounder?"
    return Level.OK, "ok"
