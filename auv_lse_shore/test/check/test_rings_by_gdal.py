"""GDAL counts the rings of drawn files; each is used, or listed as ignored."""

from __future__ import annotations

import numpy as np
import pytest

from auv_lse_shore.areas.area_file import read_area

pyogrio = pytest.importorskip("pyogrio")
shapely = pytest.importorskip("shapely")

SUFFIXES = {"GeoJSON": ".geojson", "GPKG": ".gpkg", "ESRI Shapefile": ".shp", "LIBKML": ".kml"}


def square(east, north, size):
    return [(8.5 + east, 47.3 + north), (8.5 + east + size, 47.3 + north), (8.5 + east + size, 47.3 + north + size)]


def drawn(rng):
    """Names and geometries: an area, no-go areas and shores in one or several parts, each with holes."""
    holes = [square(0.001 + 0.003 * i, 0.001, 0.001) for i in range(int(rng.integers(0, 4)))]
    features = [("Survey", shapely.Polygon(square(0.0, 0.0, 0.1), holes))]
    for number in range(int(rng.integers(0, 6))):
        parts = [
            shapely.Polygon(
                square(0.03 + 0.004 * number, 0.01 * part, 0.003),
                [square(0.0315 + 0.004 * number, 0.0005 + 0.01 * part, 0.0005)] * bool(rng.integers(0, 2)),
            )
            for part in range(int(rng.integers(1, 4)))
        ]
        role = ("No-go {}", "Island {}", "Shore {}")[rng.integers(0, 3)]
        features.append((role.format(number), shapely.MultiPolygon(parts) if len(parts) > 1 else parts[0]))
    return [features[i] for i in rng.permutation(len(features))]


def rings_by_gdal(path):
    rings = 0
    for layer, _ in pyogrio.list_layers(path):
        shapes = shapely.from_wkb(pyogrio.raw.read(path, layer=layer, force_2d=True)[2])
        rings += len(shapely.get_rings(shapely.get_parts(shapes)))
    return rings


@pytest.mark.parametrize("driver", SUFFIXES)
def test_rings_used_and_ignored_are_those_of_the_file(tmp_path, driver):
    counts = []
    for seed in range(25):
        features = drawn(np.random.default_rng(seed))
        path = tmp_path / f"{seed}{SUFFIXES[driver]}"
        pyogrio.raw.write(
            path,
            shapely.to_wkb([shape for _, shape in features]),
            [np.array([name for name, _ in features], dtype=object)],
            ["Name"],
            driver=driver,
            geometry_type="Unknown" if driver != "ESRI Shapefile" else "Polygon",
            crs="EPSG:4326",
        )
        content = read_area(path)
        used = (content.area is not None) + len(content.no_go) + len(content.shores)
        counts.append((used + len(content.ignored), rings_by_gdal(path)))
        assert all("hole" in name for name in content.ignored)
    assert [mine for mine, _ in counts] == [gdals for _, gdals in counts]
    assert max(gdals for _, gdals in counts) > 20
