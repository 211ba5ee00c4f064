"""Bathymetry files for the tests of ground from files."""

import functools

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import cKDTree

from auv_lse_common.mission_file.sections.world import LakeConfig
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_sim.ground.lake import SyntheticLake

#: Where the survey's local origin lies (deg, WGS84).
SURVEY_ORIGIN = (17.1221, -91.6281)
SURVEY_FILES = ("survey.csv", "survey.npz")


def bottom(north, east):
    return 20.0 + 5.0 * np.sin(np.asarray(north) / 80.0) + 4.0 * np.cos(np.asarray(east) / 100.0)


def soundings(n=3000, size=400.0):
    rng = np.random.default_rng(0)
    north, east = rng.uniform(0, size, n), rng.uniform(0, size, n)
    return north, east, bottom(north, east)


def write_csv(path, header, *columns, separator=","):
    rows = [separator.join(f"{v:.9g}" for v in row) for row in zip(*columns, strict=True)]
    path.write_text(separator.join(header) + "\n" + "\n".join(rows) + "\n")
    return path


def check_bottom(ground, offset=(0.0, 0.0), low=40.0, high=360.0, tolerance=0.3):
    rng = np.random.default_rng(1)
    n, e = rng.uniform(low, high, 300), rng.uniform(low, high, 300)
    depth = ground.depth_m(n - offset[0], e - offset[1])
    assert np.isfinite(depth).all()
    assert np.abs(depth - bottom(n, e)).max() < tolerance


def topobathy(share_of_land=2 / 3):
    """Elevations (m) of a lake's bottom and the land around it: water surface at 0, from -30 to 60 or so."""
    axis = np.arange(0.0, 401.0, 10.0)
    north, east = np.meshgrid(axis, axis, indexing="ij")
    height = 0.2 * (east - 400.0 * (1.0 - share_of_land)) + np.sin(north / 50.0)
    return axis, height


def write_grid(path, axis, values, name="elevation_m"):
    if path.suffix == ".asc":
        path.write_text(ascii_text(values, 0.0, 0.0, 10.0, "xllcenter"))
    elif path.suffix == ".npz":
        np.savez(path, north_m=axis, east_m=axis, **{name: values})
    else:
        north, east = np.meshgrid(axis, axis, indexing="ij")
        write_csv(path, ["north_m", "east_m", name], north.ravel(), east.ravel(), values.ravel())
    return path


def ascii_text(depth, x, y, step, corner="xllcorner", nodata=-9999):
    head = f"ncols {depth.shape[1]}\nnrows {depth.shape[0]}\n{corner} {x}\n{corner.replace('x', 'y', 1)} {y}\n"
    rows = "\n".join(" ".join(f"{nodata if np.isnan(v) else v:.4f}" for v in row) for row in depth[::-1])
    return head + f"cellsize {step}\nNODATA_value {nodata}\n" + rows + "\n"


@functools.cache
def survey():
    """A lake of 1.8 km2 and its survey as a boat makes it: lines 35 m apart, a sounding each 7 m, a part left out.

    Returns:
        The lake, and north, east, depth (m) of the soundings, shape (n, 3).
    """
    lake = SyntheticLake(LakeConfig(seed=3, north_m=0.0, east_m=0.0, height_m=1000.0, width_m=1200.0))
    e = lake.extent
    lines = np.arange(e.north_min_m, e.north_max_m, 35.0)
    along = np.arange(e.east_min_m, e.east_max_m, 7.0)
    north, east = (a.ravel() for a in np.meshgrid(lines, along, indexing="ij"))
    rng = np.random.default_rng(4)
    north, east = north + rng.normal(0.0, 3.0, north.size), east + rng.normal(0.0, 1.0, east.size)
    depth = lake.depth_m(north, east) + rng.normal(0.0, 0.05, north.size)
    sounded = (depth > 1.5) & (np.hypot(north - 250.0, east + 200.0) > 150.0)
    return lake, np.column_stack([north, east, depth])[sounded]


def write_survey(folder):
    """Writes the survey as soundings (CSV) and, gridded at 10 m as survey software does, as an npz file."""
    _, rows = survey()
    north, east, depth = rows.T
    latitude, longitude = geodetic_from_local(north, east, *SURVEY_ORIGIN)
    text = "\n".join(
        f"{a:.9f},{o:.9f},{e:.2f},{n:.2f},{d:.3f}"
        for a, o, e, n, d in zip(latitude, longitude, east, north, depth, strict=True)
    )
    (folder / SURVEY_FILES[0]).write_text("lat,lon,east_m,north_m,depth_m\n" + text + "\n")
    axes = [np.arange(np.floor(a.min()), a.max(), 10.0) for a in (north, east)]
    positions = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    np.savez(
        folder / SURVEY_FILES[1],
        north_m=axes[0],
        east_m=axes[1],
        depth_m=LinearNDInterpolator(rows[:, :2], depth)(positions),
        dist_to_sounding_m=cKDTree(rows[:, :2]).query(positions)[0],
        lat0=SURVEY_ORIGIN[0],
        lon0=SURVEY_ORIGIN[1],
    )
