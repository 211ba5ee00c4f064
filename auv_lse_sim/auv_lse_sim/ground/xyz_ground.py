"""Ground from XYZ text without a header: x, y and a value on each line, as GDAL and survey programs write it."""

from pathlib import Path

import numpy as np

from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_common.support.input_bounds import MAX_SOUNDINGS, MAX_TEXT_BYTES, over_size
from auv_lse_common.support.text import decoded
from auv_lse_common.vocabulary.frames import local_from_geodetic, unwrapped_deg
from auv_lse_gp.no_data import is_no_data
from auv_lse_gp.soundings import is_far
from auv_lse_sim.ground.band_meaning import text_says_up
from auv_lse_sim.ground.depth_sign import grid_depths
from auv_lse_sim.ground.grid_ground import GridGround
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.local_frame import check_near
from auv_lse_sim.ground.soundings_ground import check_together, grid_soundings

#: Bytes among which the first line of values is sought.
_BEGIN_BYTES = 1 << 16


def is_xyz(path: Path) -> bool:
    """Whether a text begins with a line of three numbers instead of a header.

    Raises:
        OSError: if it cannot be read.
    """
    with path.open("rb") as file:
        begin = decoded(file.read(_BEGIN_BYTES)).splitlines()
    first = next((line for line in begin if line.strip() and not line.lstrip().startswith("#")), "")
    return _row(first) is not None


def read_xyz_ground(path: Path, config: BathymetryConfig, origin: tuple[float, float] | None) -> GridGround:
    """Reads ground from XYZ text; x, y are longitude, latitude if they can be, else metres.

    Metres far from 0 (projected ones) count from their middle.

    Raises:
        GroundError: naming the line, or what is impossible.
    """
    if too_large := over_size(path, MAX_TEXT_BYTES):
        raise GroundError(f"{too_large}. Cut the grid, or make it coarser")
    values: list[tuple[float, float, float]] = []
    lines: list[int] = []
    for number, line in enumerate(decoded(path.read_bytes()).splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        row = _row(line)
        if row is None:
            raise GroundError(f"{path}:{number}: {line.strip()[:60]!r}; write three numbers: x, y and the depth")
        if len(values) == MAX_SOUNDINGS:
            raise GroundError(f"{path} has more than {MAX_SOUNDINGS:,} points. Thin them out, or grid them (.tif)")
        values.append(row)
        lines.append(number)
    x, y, z = np.array(values).T
    unknown = ~np.isfinite(z) | is_no_data(z)
    depth, notes = grid_depths(z[~unknown], path, "the third column", text_says_up(path.stem), config)
    notes += [f"{int(unknown.sum())} points without a value left out"] if unknown.any() else []
    kept = np.flatnonzero(~unknown)[np.isfinite(depth)]
    x, y, depth = x[kept], y[kept], depth[np.isfinite(depth)]
    if not len(depth):
        raise GroundError(f"{path} has no point with a depth")
    where = [lines[k] for k in kept]
    is_geodetic = bool((np.abs(x) <= 360.0).all() and (np.abs(y) <= 90.0).all() and np.ptp(y) < 10.0)
    if is_geodetic and np.ptp(unwrapped_deg(x)) < 10.0:
        x = unwrapped_deg(x)
        origin = origin or (float(y.min() + y.max()) / 2.0, (float(x.min() + x.max()) / 2.0 + 180.0) % 360.0 - 180.0)
        north, east = local_from_geodetic(y, x, *origin)
        check_near(path, north, east, y, x, origin)
        notes.append("x, y taken as longitude, latitude")
    else:
        north, east = y, x
        if is_far(north, east):
            middle = float(np.median(x)), float(np.median(y))
            north, east, origin = y - middle[1], x - middle[0], None
            notes.append(f"no projection given: local origin put at its {middle[0]:.1f}, {middle[1]:.1f}")
    check_together(path, north, east, where)
    return grid_soundings(north, east, depth, config, name=path.name, origin=origin, notes=tuple(notes))


def _row(line: str) -> tuple[float, float, float] | None:
    """The three numbers of a line, separated by blanks, semicolons or commas; None if it has others."""
    for separator in (";", None, ","):
        fields = [f.strip() for f in line.split(separator) if f.strip()]
        if len(fields) != 3:
            continue
        try:
            x, y, z = (float(f.replace(",", ".")) for f in fields)
        except ValueError:
            return None
        return x, y, z
    return None
