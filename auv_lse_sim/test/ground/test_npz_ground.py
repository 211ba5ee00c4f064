"""Ground from npz grids."""

import numpy as np
import pytest
from ground_helpers import bottom, check_bottom

from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.ground_files import load_ground


def test_npz(tmp_path):
    axis = np.arange(-50.0, 451.0, 10.0)
    depth = bottom(*np.meshgrid(axis, axis, indexing="ij"))
    distance = np.zeros_like(depth)
    distance[:, -5:] = 100.0
    np.savez(
        tmp_path / "g.npz", north_m=axis, east_m=axis, depth_m=depth, lat0=10.0, lon0=20.0, dist_to_sounding_m=distance
    )
    ground = load_ground(tmp_path / "g.npz")
    assert ground.origin == (10.0, 20.0)
    check_bottom(ground, tolerance=0.05)
    assert np.isnan(ground.depth_m(100.0, 430.0))
    np.savez(tmp_path / "e.npz", north_m=axis, east_m=axis, elevation_m=-depth)
    check_bottom(load_ground(tmp_path / "e.npz"), tolerance=0.05)


@pytest.mark.parametrize(
    ("arrays", "match"),
    [
        ({"depth_m": np.ones((3, 3))}, "has the arrays depth_m; needed are east_m"),
        (
            {"north_m": [0, 1, 2], "east_m": [0, 1], "depth_m": np.ones((3, 3))},
            r"shape \(3, 3\), north_m \(3,\), east_m \(2,\); they must be",
        ),
        (
            {"north_m": [0, 1, 5], "east_m": [0, 1, 2], "depth_m": np.ones((3, 3))},
            "north_m must increase in even steps .*from 0 to 5",
        ),
        ({"north_m": [0, 1, 2], "east_m": [0, 1, 2], "depth_m": -np.ones((3, 3))}, "mostly negative"),
        (
            {"north_m": [0, 1, 2], "east_m": [0, 1, 2], "depth_m": np.full((3, 3), 2e4)},
            "depth 20000 m is deeper than",
        ),
        ({"north_m": [0, 1, 2], "east_m": [0, 1, 2], "depth_m": np.full((3, 3), np.nan)}, "0 grid nodes hold water"),
        (
            {"north_m": [0, 1, 2], "east_m": [0, 1, 2], "depth_m": np.full((3, 3), "x")},
            "depth_m holds <U1, not numbers",
        ),
        (
            {"north_m": [0, 1, 2], "east_m": [0, 1, 2], "depth_m": np.ones((3, 3)), "lat0": 3.0},
            "only one of lat0, lon0",
        ),
        (
            {"north_m": [0, 1, 2], "east_m": [0, 1, 2], "depth_m": np.ones((3, 3)), "lat0": [3.0, 4.0], "lon0": 5.0},
            r"lat0, lon0 must be one latitude .*, not of shapes \(2,\), \(\)",
        ),
        (
            {"north_m": [0, 1, 2], "east_m": [0, 1, 2], "depth_m": np.ones((3, 3)), "lat0": "north", "lon0": 5.0},
            r"lat0, lon0 must be one latitude",
        ),
        (
            {"north_m": [0, 1, 2], "east_m": [0, 1, 2], "depth_m": np.ones((3, 3)), "lat0": 500.0, "lon0": 5.0},
            r"lat0, lon0: 500, 5 is not a position in degrees, with a latitude of -90 to 90",
        ),
        (
            {"north_m": [0, 1, 2], "east_m": [0, 1, 2], "depth_m": np.ones((3, 3)), "lat0": 5.0, "lon0": np.nan},
            r"lat0, lon0: 5, nan is not a position in degrees",
        ),
    ],
)
def test_what_is_wrong_in_an_npz(tmp_path, arrays, match):
    np.savez(tmp_path / "g.npz", **arrays)
    with pytest.raises(GroundError, match=match):
        load_ground(tmp_path / "g.npz")


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_damaged_npz(tmp_path, save):
    axis = np.arange(0.0, 101.0, 10.0)
    path = tmp_path / "g.npz"
    save(path, north_m=axis, east_m=axis, depth_m=np.full((11, 11), 9.5), lat0=1.0, lon0=2.0)
    good = path.read_bytes()
    rng = np.random.default_rng(0)
    said = []
    for i in range(400):
        if i < 100:
            bad = good[: len(good) * i // 100]
        else:
            damaged = np.frombuffer(good, np.uint8).copy()
            damaged[rng.integers(len(good), size=3)] ^= np.uint8(rng.integers(1, 256))
            bad = damaged.tobytes()
        path.write_bytes(bad)
        try:
            load_ground(path)
        except GroundError as error:
            said.append(str(error))
    assert len(said) > 300
    assert all("g.npz" in text for text in said)
    with path.open("wb") as file:
        np.save(file, np.ones((3, 3)))
    with pytest.raises(
        GroundError, match=r"^[^:]*g\.npz is a single array of shape \(3, 3\) \(npy\); save .* as an npz file"
    ):
        load_ground(path)


def test_an_npz_array_with_a_damaged_header_is_refused(tmp_path):
    import zipfile

    np.savez(tmp_path / "a.npz", north_m=[0.0, 1.0], east_m=[0.0, 1.0], depth_m=np.ones((2, 2)))
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        arrays = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(tmp_path / "b.npz", "w") as archive:
        for name, data in arrays.items():
            archive.writestr(name, data.replace(b"(2,)", b"(2, ").replace(b"}", b" "))
    with pytest.raises(ValueError, match="damaged or not npz"):
        load_ground(tmp_path / "b.npz")
