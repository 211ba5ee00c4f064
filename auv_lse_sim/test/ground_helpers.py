"""Bathymetry files for the tests of ground from files."""

import numpy as np


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
