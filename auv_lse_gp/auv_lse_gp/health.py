"""What gp_node's diagnostics say about a map."""

from __future__ import annotations

from collections.abc import Mapping

from auv_lse_common.health import Health, Level
from auv_lse_gp.depth_map import DepthMap
from auv_lse_gp.places.placer import Placer


def map_health(
    depth_map: DepthMap,
    update_s: float,
    field_s: float,
    gated: Mapping[str, int] | None = None,
    placer: Placer | None = None,
) -> Health:
    """The state of a map.

    Args:
        depth_map: The map.
        update_s: Wall clock that its last update took (s).
        field_s: Wall clock that field and isobath took (s).
        gated: Own soundings that the gate has refused, by kind.
        placer: What corrects the places of its soundings, if anything does.
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
    if placer is not None and placer.correction is not None:
        values |= {
            "places corrected at": f"{placer.correction.stamp_s:.0f} s",
            "map made again": placer.rebooked,
            "ranges": len(placer.smoother.ranges),
            "ranges and fixes refused": placer.correction.refused,
            "navigation refused": placer.smoother.refused,
        }
    values |= {f"samples of auv{k} that do not fit": f"{m.outliers} of {m.heard}" for k, m in depth_map.team.items()}
    values |= {f"soundings {kind}": number for kind, number in (gated or {}).items()}
    suspicious = [f"auv{k}" for k, m in sorted(depth_map.team.items()) if m.suspicious]
    if suspicious:
        text = f"samples of {', '.join(suspicious)} do not fit the own map: its place, its sensor, or a forger?"
        return Health(level=Level.WARN, text=text, values=values)
    if counts.full:
        text = f"{counts.full} soundings given up: the map has gp.max_centers = {depth_map.gp.config.max_centers}"
        return Health(level=Level.WARN, text=text, values=values)
    if counts.refused:
        return Health(level=Level.WARN, text=f"{counts.refused} soundings refused", values=values)
    if gated:
        kinds = ", ".join(f"{number} {kind}" for kind, number in sorted(gated.items()))
        return Health(level=Level.WARN, text=f"own soundings refused: {kinds}", values=values)
    return Health(level=Level.OK, text="ok", values=values)
