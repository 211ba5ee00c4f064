"""Areas from GeoJSON, KML and QGroundControl files."""

from __future__ import annotations

import gzip
import json

import numpy as np
import pytest

from auv_lse_common.mission_file.parameter_file import read_parameter_file
from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.input_bounds import MAX_CORNERS
from auv_lse_common.vocabulary.frames import local_from_geodetic
from auv_lse_shore.areas.area_file import read_area
from auv_lse_shore.check.findings import Findings
from auv_lse_shore.check.mission_file import check_file

LAKE = [[8.500, 47.300], [8.508, 47.300], [8.508, 47.305], [8.500, 47.305]]
ISLAND = [[8.503, 47.302], [8.504, 47.302], [8.504, 47.303]]
START, RECOVERY = [8.501, 47.301], [8.502, 47.304]


def feature(name, kind, coordinates):
    return {"type": "Feature", "properties": {"name": name}, "geometry": {"type": kind, "coordinates": coordinates}}


def geojson(*features):
    return json.dumps({"type": "FeatureCollection", "features": list(features)})


GEOJSON = geojson(
    feature("My lake", "Polygon", [[*LAKE, LAKE[0]], [*ISLAND, ISLAND[0]]]),
    feature("No-go: pier", "MultiPolygon", [[[*ISLAND, ISLAND[0]]]]),
    feature("start 2", "Point", [*START, 0.0]),
    feature("recovery", "Point", RECOVERY),
    feature("harbor", "Point", START),
)


def kml(*placemarks):
    return (
        '<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Folder>'
        + "".join(placemarks)
        + "</Folder></Document></kml>"
    )


def kml_ring(ring, side="outer"):
    positions = " ".join(f"{lon},{lat},0" for lon, lat in [*ring, ring[0]])
    return f"<{side}BoundaryIs><LinearRing><coordinates>\n{positions}\n</coordinates></LinearRing></{side}BoundaryIs>"


KML = kml(
    f"<Placemark><name>My lake</name><Polygon>{kml_ring(LAKE)}{kml_ring(ISLAND, 'inner')}</Polygon></Placemark>",
    f"<Placemark><name>No-go: pier</name><Polygon>{kml_ring(ISLAND)}</Polygon></Placemark>",
    f"<Placemark><name>start 2</name><Point><coordinates>{START[0]},{START[1]}</coordinates></Point></Placemark>",
    f"<Placemark><name>recovery</name><Point><coordinates>{RECOVERY[0]},{RECOVERY[1]}</coordinates></Point>"
    "</Placemark>",
    f"<Placemark><name>harbor</name><Point><coordinates>{START[0]},{START[1]}</coordinates></Point></Placemark>",
)


def lat_lon(positions):
    return np.array(positions)[:, ::-1]


@pytest.mark.parametrize(("name", "text"), [("lake.geojson", GEOJSON), ("lake.json", GEOJSON), ("lake.kml", KML)])
def test_geojson_and_kml_give_the_same_positions(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    positions = read_area(tmp_path / name)
    np.testing.assert_array_equal(positions.area, lat_lon(LAKE))
    assert list(positions.no_go) == ["no_go_pier", "hole_1"]
    np.testing.assert_array_equal(positions.no_go["hole_1"], lat_lon(ISLAND))
    assert positions.starts == {2: tuple(START[::-1])}
    assert positions.recoveries == {0: tuple(RECOVERY[::-1])}
    assert positions.ignored == ["harbor"]


def test_qgroundcontrol_plan_has_a_fence_and_rally_points(tmp_path):
    plan = {
        "fileType": "Plan",
        "geoFence": {
            "polygons": [
                {"inclusion": True, "polygon": lat_lon(LAKE).tolist()},
                {"inclusion": False, "polygon": lat_lon(ISLAND).tolist()},
            ],
            "circles": [{"inclusion": False, "circle": {"center": [47.304, 8.505], "radius": 25.0}}],
        },
        "rallyPoints": {"points": [[*RECOVERY[::-1], 0.0]]},
    }
    (tmp_path / "lake.plan").write_text(json.dumps(plan))
    positions = read_area(tmp_path / "lake.plan")
    np.testing.assert_array_equal(positions.area, lat_lon(LAKE))
    assert positions.recoveries == {0: tuple(RECOVERY[::-1])}
    circle = positions.no_go["no_go_circle_1"]
    north, east = local_from_geodetic(circle[:, 0], circle[:, 1], 47.304, 8.505)
    edges = np.stack([north + np.roll(north, 1), east + np.roll(east, 1)]) / 2.0
    np.testing.assert_allclose(np.hypot(*edges), 25.0, atol=1e-5, err_msg="no part of the circle is outside")


SHORE = [[8.500, 47.300], [8.508, 47.300]]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("lake.geojson", geojson(feature("lake", "Polygon", [LAKE]), feature("Shore", "LineString", SHORE))),
        (
            "lake.kml",
            kml(
                f"<Placemark><name>lake</name><Polygon>{kml_ring(LAKE)}</Polygon></Placemark>",
                "<Placemark><name>Shore</name><LineString><coordinates>8.5,47.3 8.508,47.3</coordinates></LineString>"
                "</Placemark>",
            ),
        ),
    ],
)
def test_a_line_named_shore_is_the_shore(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    found = Settings.load(None, {"area.file": str(tmp_path / name)}, read_area)
    corners = np.reshape(found.area.shore["shore_1"], (-1, 2))
    assert found.area.shore_depth_m == 0.0
    np.testing.assert_allclose(corners[:, 0], min(found.area.polygon_m[::2]), atol=0.02)
    np.testing.assert_allclose(np.ptp(corners[:, 1]), np.ptp(found.area.polygon_m[1::2]), atol=0.02)


@pytest.mark.parametrize(
    ("origin", "on_top", "expected"),
    [
        ((47.29, 8.49), {}, (47.29, 8.49)),  # starts and gp.survey_file count from there
        ((46.0, 6.0), {}, (47.3025, 8.504)),  # another lake's
        ((47.29, 8.49), {"area.origin_lat_deg": 47.28}, (47.28, 8.49)),
    ],
)
def test_an_area_file_keeps_the_missions_origin(tmp_path, origin, on_top, expected):
    (tmp_path / "lake.geojson").write_text(geojson(feature("lake", "Polygon", [LAKE])))
    path = tmp_path / "mission.yaml"
    path.write_text(
        f"/**:\n  ros__parameters:\n    area: {{origin_lat_deg: {origin[0]}, origin_lon_deg: {origin[1]}}}\n"
    )
    area = Settings.load(path, {"area.file": str(tmp_path / "lake.geojson"), **on_top}, read_area).area
    assert (area.origin_lat_deg, area.origin_lon_deg) == pytest.approx(expected, abs=1e-3)
    checked = check_file(path, Findings(), read_area, tmp_path / "lake.geojson", on_top)[0].area
    assert checked == area
    north, east = local_from_geodetic(LAKE[0][1], LAKE[0][0], area.origin_lat_deg, area.origin_lon_deg)
    assert area.polygon_m[:2] == pytest.approx((float(north), float(east)), abs=0.02)


def test_a_polygon_may_be_the_shore(tmp_path):
    (tmp_path / "lake.geojson").write_text(
        geojson(feature("lake", "Polygon", [LAKE]), feature("shoreline", "Polygon", [[*LAKE, LAKE[0]], ISLAND]))
    )
    positions = read_area(tmp_path / "lake.geojson")
    assert [len(shore) for shore in positions.shores] == [5, 4]
    assert not positions.no_go


BAD = {
    "swapped": (geojson(feature("a", "Polygon", [[[47.3, 108.5], [47.4, 108.5], [47.4, 108.6]]])), "swapped"),
    "one_swapped": (geojson(feature("a", "Polygon", [[*LAKE[:3], [47.3, 8.5]]])), "swapped in one of its features"),
    "two_areas": (
        geojson(feature("a", "Polygon", [LAKE]), feature("b", "Polygon", [ISLAND])),
        "'a', 'b'. Name a polygon",
    ),
    "two_starts": (geojson(feature("start 1", "Point", START), feature("start 1", "Point", START)), "second start"),
    "nothing": (geojson(feature("harbor", "Point", START)), "has no polygon, only 'harbor'"),
    "empty": ("", "is empty"),
    "not_json": ("{", "is not valid JSON.*Expecting property name"),
    "a_list": ("[1, 2]", "is a list, not GeoJSON"),
    "text_as_coordinates": (geojson(feature("a", "Polygon", "x")), "has the geometry .*not GeoJSON"),
    "nan": (geojson(feature("a", "Polygon", [[[8.5, float("nan")], [8.6, 47.0], [8.6, 47.1]]])), "latitude nan"),
    "no_corners": (geojson(feature("a", "Polygon", [[]])), "polygon 'a' has no corners"),
    "huge_number": (geojson(feature("a", "Polygon", [[[10**400, 47.0], [8.6, 47.0]]])), "is damaged"),
    "endless_number": (geojson(feature("start " + 5000 * "9", "Point", START)), "no number of a vehicle"),
    "other_crs": (
        json.dumps({"type": "FeatureCollection", "crs": {"properties": {"name": "my own"}}, "features": []}),
        "Export it as EPSG:4326",
    ),
    "many_corners": (
        geojson(feature("a", "Polygon", [[[8.0 + i * 1e-5, 47.0] for i in range(MAX_CORNERS + 1)]])),
        "'a' has 2,001 corners",
    ),
}


@pytest.mark.parametrize(("text", "expected"), BAD.values(), ids=BAD)
def test_unusable_file_is_named_with_its_reason(tmp_path, text, expected):
    (tmp_path / "lake.geojson").write_text(text)
    with pytest.raises(ParameterError, match=expected) as error:
        read_area(tmp_path / "lake.geojson")
    assert str(tmp_path / "lake.geojson") in str(error.value)


def test_kml_with_entities_and_files_of_other_kinds_are_refused(tmp_path):
    (tmp_path / "a.kml").write_text('<!DOCTYPE x [<!ENTITY a "aaaa">]>' + KML.partition("?>")[2])
    (tmp_path / "a.shp").write_text("")
    with pytest.raises(ParameterError, match="document type"):
        read_area(tmp_path / "a.kml")
    with pytest.raises(ParameterError, match=r"is empty\. Save the area as GeoJSON, KML"):
        read_area(tmp_path / "a.shp")
    with pytest.raises(ParameterError, match="cannot be read"):
        read_area(tmp_path / "missing.kml")


def mission(tmp_path, text):
    path = tmp_path / "mission.yaml"
    path.write_text(text)
    return path


def test_mission_file_names_a_file_of_positions_beside_it(tmp_path):
    (tmp_path / "lake.kml").write_text(KML)
    path = mission(tmp_path, "/**:\n  ros__parameters:\n    area: {file: lake.kml}\n    mission: {vehicles: 2}\n")
    settings = Settings.load(path, read_area=read_area)
    origin = settings.area.origin_lat_deg, settings.area.origin_lon_deg
    assert origin == (47.3025, 8.504)
    north, east = local_from_geodetic(*lat_lon(LAKE).T, *origin)
    np.testing.assert_allclose(np.reshape(settings.area.polygon_m, (-1, 2)), np.column_stack([north, east]), atol=0.006)
    assert set(settings.area.no_go) == {"no_go_pier", "hole_1"}
    one, two = (own.vehicle for own in settings.vehicles)
    north, east = local_from_geodetic(*START[::-1], *origin)
    assert (two.start_north_m, two.start_east_m) == pytest.approx((float(north), float(east)), abs=0.006)
    assert (one.start_north_m, one.start_east_m) == (0.0, 0.0)
    assert one.recovery_north_m == two.recovery_north_m is not None
    again = mission(tmp_path, settings.to_parameter_file())
    assert Settings.load(again).area == settings.area


@pytest.mark.parametrize(
    ("name", "is_area"),
    [("Islander bay", True), ("Lugano Golf", True), ("Homestead", True), ("island", False), ("no go: pier", False)],
)
def test_only_whole_words_name_a_no_go_area(tmp_path, name, is_area):
    (tmp_path / "lake.geojson").write_text(geojson(feature(name, "Polygon", [LAKE])))
    assert (read_area(tmp_path / "lake.geojson").area is not None) == is_area


def test_a_file_without_an_operating_area_needs_the_mission_files(tmp_path):
    (tmp_path / "lake.geojson").write_text(geojson(feature("island", "Polygon", [ISLAND])))
    area = "origin_lat_deg: 47.3, origin_lon_deg: 8.5, file: lake.geojson"
    with pytest.raises(ParameterError, match="no polygon is the operating area"):
        read_parameter_file(mission(tmp_path, f"/**:\n  ros__parameters:\n    area: {{{area}}}\n"), read_area)
    polygon = "polygon_m: [0.0, 0.0, 900.0, 0.0, 900.0, 900.0]"
    read = read_parameter_file(
        mission(tmp_path, f"/**:\n  ros__parameters:\n    area: {{{area}, {polygon}}}\n"), read_area
    )
    assert list(read["/**"]["area"]["no_go"]) == ["island"]


def test_a_file_geodatabase_is_a_folder(tmp_path):
    (tmp_path / "lake.gdb").mkdir()
    with pytest.raises(ParameterError, match=r"lake\.gdb is a folder, as a file geodatabase is\. Save the area as"):
        read_area(tmp_path / "lake.gdb")


def test_a_compressed_area_file_is_to_be_unpacked(tmp_path):
    path = tmp_path / "area.geojson.gz"
    path.write_bytes(gzip.compress(b'{"type": "FeatureCollection", "features": []}'))
    with pytest.raises(ParameterError, match=r"area\.geojson\.gz is compressed with gzip\. Unpack it first"):
        read_area(path)
