"""isobath.geojson: the isobath with its band; each piece has a class (found, likely, guessed)."""

from auv_lse_gp.map.certainty import CLASSES, length_of
from auv_lse_shore.export.content import Export
from auv_lse_shore.judge.team_map import write_isobath


def write(export: Export) -> str:
    """Writes the isobath."""
    write_isobath(export.team, export.folder / "isobath.geojson", export.team.run.origin, [], export.metadata())
    return f"isobath.geojson ({', '.join(f'{length_of(export.team.pieces, kind):.0f} m {kind}' for kind in CLASSES)})"
