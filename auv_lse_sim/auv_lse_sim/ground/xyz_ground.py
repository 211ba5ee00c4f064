"""Ground from XYZ text: x, y and a value on each line, mostly without a header, as GDAL and survey programs write."""

import dataclasses
from pathlib import Path

import numpy as np

from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_common.support.text import decoded
from auv_lse_common.vocabulary.frames import local_from_geodetic, unwrapped_deg
from auv_lse_gp.no_data import is_no_data
from auv_lse_gp.soundings import is_far
from auv_lse_gp.tables.column_names import DEPTHS, Column, named_columns
from auv_lse_gp.tables.dialect import Dialect, dialect_of
from auv_lse_gp.tables.whole_table import whole_table
from auv_lse_sim.ground.band_meaning import text_says_up
from auv_lse_sim.ground.depth_sign import grid_depths
from auv_lse_sim.ground.grid_ground import GridGround
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.local_frame import check_near
from auv_lse_sim.ground.soundings_ground import check_together, grid_soundings

#: Bytes from which it is found whether a text is XYZ.
_BEGIN_BYTES = 1 << 16
#: Roles of the columns of XYZ; their numbers are never angles.
_ROLES = ("east", "north", "z")
#: Names of x and y in the comment above.
_PAIRS = (("lon", "lat"), ("east", "north"), ("x", "y"))


def is_xyz(path: Path) -> bool:
    """Whether a text has three columns of numbers without a header, or columns x and y without units.

    Raises:
        OSError: if it cannot be read.
    """
    with path.open("rb") as file:
        text = decoded(file.read(_BEGIN_BYTES))
    dialect = dialect_of(text[: text.rfind("\n") + 1] or text)
    return dialect is not None and bool(_columns(dialect))


def _columns(dialect: Dialect) -> dict[str, Column]:
    """The columns east, north and z of XYZ, {} of another table; a comment may name them in another order."""
    names = named_columns(dialect.header, dialect.units)
    x, y = next((pair for pair in _PAIRS if {*pair} <= names.keys()), ("", ""))
    if dialect.above:
        depth = next((role for role in DEPTHS if role in names), "")
        is_plain = x == "x" and depth and not names[x].unit
        return {"east": names[x], "north": names[y], "z": names[depth]} if is_plain else {}
    if dialect.width != 3:
        return {}
    numbers = [names[x].number, names[y].number] if x else [0, 1]
    numbers += {0, 1, 2}.difference(numbers)
    by_number = {column.number: column for column in names.values()} if x else {}
    unnamed = Column(-1, "z", "", "the third column", 0)
    return {r: by_number.get(i, unnamed._replace(number=i)) for r, i in zip(_ROLES, numbers, strict=True)}


def read_xyz_ground(path: Path, config: BathymetryConfig, origin: tuple[float, float] | None) -> GridGround:
    """Reads ground from XYZ text; x, y are longitude, latitude if they can be, else metres.

    Metres far from 0 (projected ones) count from their middle.

    Raises:
        GroundError: if no point has a depth, or they are far from the origin.
        TableError: naming the line that cannot be read.
    """
    table = whole_table(path)
    table = dataclasses.replace(table, columns=_columns(table.dialect))
    values = table.read(_ROLES, may_be_nan="z")
    x, y, z = (values[role] for role in _ROLES)
    unknown = ~np.isfinite(z) | is_no_data(z)
    name, role = table.columns["z"].name, table.columns["z"].role
    up = {"depth": False, "elevation": True}.get(role, text_says_up(path.stem))
    depth, notes = grid_depths(table.metres("z", values)[~unknown], path, name, up, config)
    notes += [f"{int(unknown.sum())} points without a value left out"] if unknown.any() else []
    notes += table.unused(values)
    kept = np.flatnonzero(~unknown)[np.isfinite(depth)]
    x, y, depth = x[kept], y[kept], depth[np.isfinite(depth)]
    if not len(depth):
        raise GroundError(f"{path} has no point with a depth")
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
    check_together(lambda k: table.where(kept[k]), north, east)
    return grid_soundings(north, east, depth, config, name=path.name, origin=origin, notes=tuple(notes))
