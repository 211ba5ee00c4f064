"""Area files as other programs write them."""

from __future__ import annotations

import io
import json
import re
import sqlite3
import zipfile

import numpy as np
import pytest

from auv_lse_common.mission_file.degrees import in_metres
from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.vocabulary.frames import geodetic_from_local, local_from_geodetic
from auv_lse_shore.areas.area_file import notes_on, read_area

LAKE = [[8.500, 47.300], [8.508, 47.300], [8.508, 47.305], [8.500, 47.305], [8.500, 47.300]]
PIER = [[8.503, 47.302], [8.504, 47.302], [8.504, 47.303], [8.503, 47.302]]
AREA = np.array(LAKE[:-1])[:, ::-1]


def corners(positions):
    return " ".join(f"{x},{y},0" for x, y in positions)


def polygon(positions):
    outer = f"<LinearRing><coordinates>{corners(positions)}</coordinates></LinearRing>"
    return f"<Polygon><outerBoundaryIs>{outer}</outerBoundaryIs></Polygon>"


def placemark(name, content):
    return f"<Placemark><name>{name}</name>{content}</Placemark>"


def document(content, head="<?xml version='1.0' encoding='UTF-8'?>", attributes=""):
    return f'{head}<kml xmlns="http://www.opengis.net/kml/2.2"><Document {attributes}>{content}</Document></kml>'


LAKE_AND_PIER = placemark("Lac Léman", polygon(LAKE)) + placemark("no-go pier", polygon(PIER))


def read(tmp_path, data, name="a.kml"):
    path = tmp_path / name
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return read_area(path)


@pytest.mark.parametrize(
    "data",
    [
        document(LAKE_AND_PIER, attributes='xsi:schemaLocation="a b"').encode(),
        document(LAKE_AND_PIER.replace("Polygon>", "gx:Polygon>")).encode(),
        document(LAKE_AND_PIER, head="<?xml version='1.0' encoding='ISO-8859-1'?>").encode("latin-1"),
        document(LAKE_AND_PIER, head="<?xml version='1.0' encoding='windows-1252'?>").encode("cp1252"),
        document(LAKE_AND_PIER, head="<?xml version='1.0' encoding='UTF-16'?>").encode("utf-16"),
        document(LAKE_AND_PIER, head="<?xml version='1.0' encoding='UTF-16'?>").encode(),
        document(LAKE_AND_PIER).encode("latin-1"),
        b"\xef\xbb\xbf\r\n " + document(LAKE_AND_PIER).encode(),
        document(LAKE_AND_PIER.replace("Lac L", "A&nbsp;&B L")).encode(),
        document(LAKE_AND_PIER.replace(",", " ,\n ")).encode(),
        document(f"<Folder><name>A</name><Folder>{LAKE_AND_PIER}</Folder></Folder>").encode(),
        LAKE_AND_PIER.replace("<Placemark>", "<kml><Placemark>", 1).encode() + b"</kml>",
    ],
    ids=["xsi", "gx", "latin-1", "windows-1252", "utf-16", "not utf-16", "not utf-8", "blanks first", "html", "blanks",
         "folders", "no document"],
)  # fmt: skip
def test_kml_is_read_as_programs_write_it(tmp_path, data):
    content = read(tmp_path, data)
    np.testing.assert_array_equal(content.area, AREA)
    assert list(content.no_go) == ["no_go_pier"]
    assert not content.ignored


def test_a_folder_says_what_is_in_it(tmp_path):
    content = read(
        tmp_path,
        document(
            f"<Folder><name>No-go areas</name>{placemark('Rock', polygon(PIER))}</Folder>"
            + f"<Folder><name>Survey</name>{placemark('Bay', polygon(LAKE))}</Folder>"
        ),
    )
    assert list(content.no_go) == ["rock"]
    assert content.area_name == "Bay"


@pytest.mark.parametrize(
    "title",
    [
        "No-go zones",
        "nogo.kml",
        "Exclusion zones Lac Léman",
        "Keep-out areas 2025",
        "Islands",
        "Islands 2025.kml",
        "Hazards",
        "Forbidden",
        "Restricted areas, Forbidden Lake",
        "Lake Ontario: prohibited zones",
        "Dangerous areas",
        "Restricted waters",
        "Forbidden Lake no-go",
    ],
)
def test_the_title_of_a_document_of_no_go_areas_counts(tmp_path, title):
    rocks = placemark("Rock", polygon(PIER)) + placemark("Shallows", polygon(LAKE[1:]))
    content = read(tmp_path, document(f"<name>{title}</name>{rocks}"))
    assert content.area is None
    assert list(content.no_go) == ["rock", "shallows"]
    content = read(tmp_path, document(f"<name>{title}</name>{placemark('survey area', polygon(LAKE))}{rocks}"))
    assert content.area_name == "survey area"


@pytest.mark.parametrize(
    "title",
    [
        "Island Lake",
        "Survey and no-go zones",
        "islands of the Untersee",
        "Danger Bay",
        "geofence, no-go",
        "Bay",
        "Lough Derg incl. no-go",
        "Team 3: area, no-go zones, start positions",
        "Forbidden Lake",
        "Prohibited Lake 2025",
        "Restricted Bay",
        "Lake Avoid",
        "Avoid Lake.kml",
        "Small Island Lake",
        "Dangerous Reef",
    ],
)
def test_the_title_of_a_document_may_contain_words_of_no_go_areas(tmp_path, title):
    content = read(tmp_path, document(f"<name>{title}</name>{placemark('Bay', polygon(LAKE))}"))
    assert content.area_name == "Bay"


def test_every_part_of_a_multigeometry_counts(tmp_path):
    content = read(
        tmp_path,
        document(
            placemark("Bay", polygon(LAKE))
            + placemark("islands", f"<MultiGeometry>{polygon(PIER)}{polygon(LAKE[1:])}</MultiGeometry>")
        ),
    )
    assert list(content.no_go) == ["islands", "islands_2"]


def test_what_has_no_use_is_listed(tmp_path):
    content = read(
        tmp_path,
        document(
            placemark("Bay", polygon(LAKE))
            + placemark("dive spot", "<Point><coordinates>8.5,47.3</coordinates></Point>")
            + placemark("road", f"<LineString><coordinates>{corners(LAKE[:3])}</coordinates></LineString>")
            + placemark("tour", f"<gx:Tour><coordinates>{corners(PIER)}</coordinates></gx:Tour>")
            + "<GroundOverlay><name>chart</name></GroundOverlay><NetworkLink><name>more</name></NetworkLink>"
            + placemark("nothing", "")
        ),
    )
    assert content.ignored == [
        "dive spot", "road", "tour (1 coordinates of an unknown kind)", "chart (GroundOverlay)", "more (NetworkLink)",
        "nothing (without a geometry)",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("<Point><coordinates>8</coordinates></Point>", "'8'"),
        ("<Polygon></Polygon>", "0 outer rings"),
        (f"<Polygon><innerBoundaryIs>{polygon(PIER)}</innerBoundaryIs></Polygon>", "0 outer rings"),
    ],
)
def test_coordinates_that_are_none_are_refused_by_name(tmp_path, content, expected):
    with pytest.raises(ParameterError, match=f"'Bay' has.*{expected}"):
        read(tmp_path, document(placemark("Bay", content)))


def test_kmz_is_unpacked(tmp_path):
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("files/icon.png", b"")
        archive.writestr("doc.kml", document(LAKE_AND_PIER))
    content = read(tmp_path, packed.getvalue(), "a.kmz")
    np.testing.assert_array_equal(content.area, AREA)
    with pytest.raises(ParameterError, match="cannot be unpacked"):
        read(tmp_path, packed.getvalue()[:-40], "b.kmz")


def test_a_kmz_that_macos_packed_is_read(tmp_path):
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.kml", document(LAKE_AND_PIER))
        archive.writestr("__MACOSX/._doc.kml", b"\0\5\x16\7 Mac OS X")
    np.testing.assert_array_equal(read(tmp_path, packed.getvalue(), "a.kmz").area, AREA)


def gdal_file(tmp_path, name, crs="EPSG:4326", **layers):
    pyogrio = pytest.importorskip("pyogrio")
    import shapely

    path = tmp_path / name
    for layer, rings in layers.items():
        shapes = np.array([shapely.to_wkb(shapely.Polygon(r)) for r in rings.values()])
        pyogrio.raw.write(
            path,
            shapes,
            [np.array(list(rings), dtype=object)],
            ["NAME"],
            layer=layer,
            crs=crs,
            geometry_type="Polygon",
            append=path.exists(),
        )
    return path


def test_every_layer_of_a_geopackage_counts(tmp_path):
    content = read_area(gdal_file(tmp_path, "a.gpkg", lakes={"Bay": LAKE}, exclusion_zones={"rock": PIER}))
    np.testing.assert_array_equal(content.area, AREA)
    assert list(content.no_go) == ["rock"]


def test_a_shapefile_is_read_in_its_own_projection_and_zipped(tmp_path):
    from pyproj import Transformer

    transformer = Transformer.from_crs(4326, 2056, always_xy=True)
    swiss = [transformer.transform(*corner) for corner in LAKE]
    gdal_file(tmp_path, "a.shp", crs="EPSG:2056", a={"Bay": swiss})
    content = read_area(tmp_path / "a.shp")
    assert {tuple(row) for row in np.round(content.area, 6)} == {tuple(row) for row in AREA}
    packed = tmp_path / "a.zip"
    with zipfile.ZipFile(packed, "w") as archive:
        for part in tmp_path.glob("a.*"):
            if part != packed:
                archive.write(part, part.name)
    np.testing.assert_array_equal(read_area(packed).area, content.area)
    with zipfile.ZipFile(packed, "a") as archive:  # as macOS packs it
        archive.writestr("__MACOSX/._a.shp", b"\0\5\x16\7 Mac OS X")
    np.testing.assert_array_equal(read_area(packed).area, content.area)


def test_parts_of_a_shapefile_that_are_missing_are_named(tmp_path):
    from pyproj import Transformer

    transformer = Transformer.from_crs(4326, 2056, always_xy=True)
    gdal_file(tmp_path, "a.shp", crs="EPSG:2056", a={"Bay": [transformer.transform(*corner) for corner in LAKE]})
    (tmp_path / "a.prj").unlink()
    with pytest.raises(ParameterError, match=r"no coordinate reference system \(a\.prj is missing\).* as EPSG:4326"):
        read_area(tmp_path / "a.shp")
    (tmp_path / "a.shx").unlink()
    with pytest.raises(ParameterError, match=r"one part of a shapefile\. Copy a\.shx, a\.dbf, a\.prj beside it"):
        read_area(tmp_path / "a.shp")
    gdal_file(tmp_path, "b.shp", b={"Bay": LAKE})
    (tmp_path / "b.prj").unlink()
    content = read_area(tmp_path / "b.shp")
    assert len(content.area) == 4
    assert content.notes == [
        "the layer 'b' has no coordinate reference system (b.prj is missing); its degrees are taken as WGS84"
    ]
    gdal_file(tmp_path, "c.shp", c={"Bay": LAKE})
    assert read_area(tmp_path / "c.shp").notes == []


def test_topojson_is_named_with_a_way_to_convert_it(tmp_path):
    (tmp_path / "a.json").write_text('{"type": "Topology", "objects": {"bay": {"type": "Polygon"}}, "arcs": []}')
    with pytest.raises(ParameterError, match=r"a\.json is TopoJSON\. Convert it to GeoJSON: ogr2ogr"):
        read_area(tmp_path / "a.json")


def test_a_zipped_shapefile_beside_a_file_with_kml_in_its_name_is_no_kmz(tmp_path):
    gdal_file(tmp_path, "a.shp", a={"Bay": LAKE})
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("from.kml.txt", "see lake.kml")
        for part in tmp_path.glob("a.[sdp]*"):
            archive.write(part, part.name)
    assert len(read_area(tmp_path / "a.zip").area) == 4


def test_layers_and_features_without_anything_are_reported(tmp_path):
    path = gdal_file(tmp_path, "a.gpkg", lakes={"Bay": LAKE}, exclusion_zones={})
    assert read_area(path).ignored == ["exclusion_zones (an empty layer)"]
    empty = [{"type": "MultiPolygon", "coordinates": []}, {"type": "GeometryCollection", "geometries": []}]
    shapes = [*empty, {"type": "Polygon", "coordinates": [LAKE]}]
    features = [{"type": "Feature", "properties": {"name": f"f{n}"}, "geometry": g} for n, g in enumerate(shapes)]
    content = read(tmp_path, json.dumps({"type": "FeatureCollection", "features": features}), "a.geojson")
    assert (content.area_name, content.ignored) == ("f2", ["f0 (empty)", "f1 (empty)"])


@pytest.mark.parametrize("mark", ["", "\x1e"])
def test_geojson_with_a_feature_on_each_line_is_read_as_qgis_writes_it(tmp_path, mark):
    shapes = {"lake": LAKE, "no-go pier": PIER}
    lines = [
        json.dumps({"type": "Feature", "properties": {"name": n}, "geometry": {"type": "Polygon", "coordinates": [c]}})
        for n, c in shapes.items()
    ]
    content = read(tmp_path, "".join(f"{mark}{line}\n" for line in lines), "a.geojsonl")
    np.testing.assert_array_equal(content.area, AREA)
    assert list(content.no_go) == ["no_go_pier"]
    indented = "".join(f"\x1e{json.dumps(json.loads(line), indent=1)}\n" for line in lines)
    assert list(read(tmp_path, indented, "a.geojsons").no_go) == ["no_go_pier"]
    with pytest.raises(ParameterError, match=r"not valid JSON: Expecting.*line 2 column"):
        read(tmp_path, '{"type": "FeatureCollection",\n"features": [,', "b.geojson")


@pytest.mark.parametrize(("name", "found"), [("lake", "'lake'"), ("no-go", "no-go area no_go")])
def test_a_polygon_that_crosses_itself_is_named_with_its_file(tmp_path, name, found):
    bow = [LAKE[0], LAKE[2], LAKE[1], LAKE[3], LAKE[0]]
    shapes = {"lake": LAKE, name: bow}
    features = [
        {"type": "Feature", "properties": {"name": n}, "geometry": {"type": "Polygon", "coordinates": [c]}}
        for n, c in shapes.items()
    ]
    (tmp_path / "a.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    with pytest.raises(ParameterError, match=rf"m\.yaml: area\.file: a\.geojson: {found} crosses itself: the edge"):
        in_metres({"/**": {"area": {"file": "a.geojson"}}}, tmp_path, "m.yaml", read_area)
    given = {"/**": {"area": {"polygon_deg": [value for lon, lat in bow for value in (lat, lon)]}}}
    with pytest.raises(ParameterError, match=r"m\.yaml: area\.polygon_deg crosses itself"):
        in_metres(given, tmp_path, "m.yaml")


def test_an_area_on_both_sides_of_the_antimeridian(tmp_path):
    lake = [(179.999, -16.8), (-179.999, -16.8), (-179.999, -16.798), (179.999, -16.798)]
    feature = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [lake]}}
    content = read(tmp_path, json.dumps(feature), "a.geojson")
    np.testing.assert_array_equal(content.area, [(lat, lon) for lon, lat in lake])
    given = {"/**": {"area": {"file": "a.geojson"}}}
    area = in_metres(given, tmp_path, "mission.yaml", read_area)["/**"]["area"]
    assert area["origin_lon_deg"] == pytest.approx(-180.0)
    assert np.abs(area["polygon_m"]).max() < 120.0


def test_a_lake_with_its_islands_as_features_says_how_to_mark_them(tmp_path):
    def square(low, high, role=""):
        ring = [(low, 47.0 + low), (high, 47.0 + low), (high, 47.0 + high), (low, 47.0 + high), (low, 47.0 + low)]
        geometry = {"type": "Polygon", "coordinates": [ring]}
        return {"type": "Feature", "properties": {"role": role} if role else {}, "geometry": geometry}

    def file(*features):
        return json.dumps({"type": "FeatureCollection", "features": features})

    islands = [(0.001 * k, 0.001 * k + 0.0005) for k in range(1, 13)]
    with pytest.raises(ParameterError, match=r"13 polygons .* others are islands, name those so, .* role: no-go$"):
        read(tmp_path, file(square(0.0, 0.02), *(square(*island) for island in islands)), "a.geojson")
    with pytest.raises(ParameterError, match=r"2 polygons may be the operating area: .* or remove it$"):
        read(tmp_path, file(square(0.0, 0.001), square(0.002, 0.003)), "a.geojson")
    parts = [square(*span)["geometry"]["coordinates"] for span in ((0.0, 0.001), (0.002, 0.003))]
    both = {"type": "Feature", "properties": {}, "geometry": {"type": "MultiPolygon", "coordinates": parts}}
    with pytest.raises(ParameterError, match=r"2 x 'feature 1'\. .* parts of one feature, split it: ogr2ogr -explode"):
        read(tmp_path, file(both), "a.geojson")
    marked = read(tmp_path, file(square(0.0, 0.02), *(square(*i, "no-go") for i in islands)), "a.geojson")
    assert len(marked.no_go) == 12
    (note,) = notes_on(tmp_path / "a.geojson", marked, 1)
    assert ", 12 no-go areas, feature_2 to feature_13" in note


def test_an_area_that_is_cut_at_the_antimeridian_is_one(tmp_path):
    def half(west, east):
        return [[(west, -16.8), (east, -16.8), (east, -16.798), (west, -16.798), (west, -16.8)]]

    def multi(*parts):
        return json.dumps({"type": "MultiPolygon", "coordinates": parts})

    content = read(tmp_path, multi(half(179.999, 180.0), half(-180.0, -179.999)), "a.geojson")
    corners = [[-16.8, 179.999], [-16.8, -179.999], [-16.798, -179.999], [-16.798, 179.999]]
    assert sorted(content.area.round(9).tolist()) == sorted(corners)
    with pytest.raises(ParameterError, match="2 polygons may be the operating area"):
        read(tmp_path, multi(half(179.998, 179.999), half(-179.999, -179.998)), "a.geojson")
    with pytest.raises(ParameterError, match="2 polygons may be the operating area"):
        read(tmp_path, multi(half(8.0, 8.001), half(8.002, 8.003)), "a.geojson")


@pytest.mark.parametrize("corner", [(315_846.0, 5_152_400.0), (288.3, -41.1)])
def test_coordinates_that_are_no_degrees_name_the_cure(tmp_path, corner):
    lake = [corner, (corner[0] + 1e-3, corner[1]), (corner[0], corner[1] + 1e-3)]
    feature = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [lake]}}
    with pytest.raises(ParameterError, match=r"is not a position in degrees\. Write WGS84 .*from -180 to 180"):
        read(tmp_path, json.dumps(feature), "a.geojson")


def test_geojson_in_another_projection_is_converted(tmp_path):
    from pyproj import Transformer

    transformer = Transformer.from_crs(4326, 2056, always_xy=True)
    feature = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [
        [transformer.transform(*corner) for corner in LAKE]]}}  # fmt: skip
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::2056"}}
    text = json.dumps({"type": "FeatureCollection", "crs": crs, "features": [feature]})
    np.testing.assert_allclose(read(tmp_path, text, "a.geojson").area, AREA, atol=1e-7)


def gpx(kind, positions, name="around"):
    tag = {"rte": "rtept", "trk": "trkpt"}[kind]
    points = "".join(f'<{tag} lat="{y:.8f}" lon="{x:.8f}"/>' for x, y in positions)
    points = f"<trkseg>{points}</trkseg>" if kind == "trk" else points
    return f'<gpx xmlns="x"><metadata/><{kind}><name>{name}</name>{points}</{kind}></gpx>'


def walked(around_m=1000.0, gap=0.0, noise_m=0.0):
    """A walk around a square of 250 m, with points every 2 m and random noise; longitude, latitude."""
    along = np.arange(0.0, around_m * (1.0 - gap), 2.0) / 250.0
    east = np.interp(along, range(5), [0, 250, 250, 0, 0])
    north = np.interp(along, range(5), [0, 0, 250, 250, 0])
    rng = np.random.default_rng(1)
    lat, lon = geodetic_from_local(
        north + noise_m * rng.standard_normal(len(along)), east + noise_m * rng.standard_normal(len(along)), 47.3, 8.5
    )
    return np.column_stack([lon, lat])


def test_a_route_is_the_outline_of_its_corners(tmp_path):
    content = read(tmp_path, gpx("rte", LAKE[:-1]), "a.gpx")
    np.testing.assert_allclose(content.area, AREA)
    assert "closed over 556 m" in content.notes[0]


def test_a_track_around_the_area_is_its_outline(tmp_path):
    content = read(tmp_path, gpx("trk", walked(gap=0.03, noise_m=1.0)), "a.gpx")
    north, east = local_from_geodetic(content.area[:, 0], content.area[:, 1], 47.3, 8.5)
    area_m2 = abs(np.sum(north * np.roll(east, 1) - east * np.roll(north, 1))) / 2.0
    assert area_m2 == pytest.approx(62_500.0, rel=0.02)  # 1 m of noise on both sides of 1 km
    assert "small loops left out" in content.notes[0]


@pytest.mark.parametrize(("gap", "expected"), [(0.25, "ends lie 250 m apart")])
def test_an_open_track_is_no_outline(tmp_path, gap, expected):
    with pytest.raises(ParameterError, match=expected):
        read(tmp_path, gpx("trk", walked(gap=gap)), "a.gpx")


def test_a_track_over_the_area_is_no_outline(tmp_path):
    eight = [LAKE[0], LAKE[2], LAKE[3], LAKE[1], LAKE[0]]
    with pytest.raises(ParameterError, match="crosses itself and encloses 2 areas"):
        read(tmp_path, gpx("trk", eight), "a.gpx")


def in_segments(*segments, name="around"):
    """A GPX file with one track of several segments."""
    one = [gpx("trk", segment, name) for segment in segments]
    inner = "".join(re.search("<trkseg>.*</trkseg>", text)[0] for text in one)
    return re.sub("<trkseg>.*</trkseg>", inner, one[0])


def test_segments_around_two_areas_are_not_joined(tmp_path):
    loop = walked()
    other = loop + np.array([0.02, 0.0])
    with pytest.raises(ParameterError, match=r"2 lines may be the operating area: 'around, segment 1', 'around, seg"):
        read(tmp_path, in_segments(loop, other), "a.gpx")
    both = gpx("rte", LAKE[:-1], "area").replace("</gpx>", "") + in_segments(loop, other, name="island")[24:]
    content = read(tmp_path, both, "a.gpx")
    assert list(content.no_go) == ["island_segment_1", "island_segment_2"]
    for ring in content.no_go.values():
        assert np.ptp(np.asarray(ring)[:, 1]) == pytest.approx(np.ptp(loop[:, 0]), rel=0.01)


def test_a_track_that_was_paused_on_the_way_around_is_one_outline(tmp_path):
    loop = walked()
    content = read(tmp_path, in_segments(loop[:200], loop[202:400], loop[400:]), "a.gpx")
    north, east = local_from_geodetic(content.area[:, 0], content.area[:, 1], 47.3, 8.5)
    assert abs(np.sum(north * np.roll(east, 1) - east * np.roll(north, 1))) / 2.0 == pytest.approx(62_500.0, rel=0.01)
    assert "3 segments joined over at most 6 m" in " ".join(content.notes)
    late = len(loop) * 93 // 100  # where the first part alone already ends near its start
    for segments in ((loop[:late], loop[late:]), (loop[:200], loop[200:201], loop[201:]), (loop, loop[7:8] + 0.01)):
        again = read(tmp_path, in_segments(*segments), "a.gpx")
        np.testing.assert_allclose(np.ptp(again.area, axis=0), np.ptp(content.area, axis=0), rtol=0.01)
    assert "1 segment of one point left out" in " ".join(again.notes)
    # half of the way around is missing: nobody knows where the border was
    with pytest.raises(ParameterError, match="2 lines may be the operating area: 'around, segment 1', 'around, seg"):
        read(tmp_path, in_segments(loop[:150], loop[400:]), "a.gpx")


def plan(**content):
    return json.dumps({"fileType": "Plan", **content})


LAT_LON = [[y, x] for x, y in LAKE[:-1]]
SURVEY = {"type": "ComplexItem", "complexItemType": "survey", "polygon": LAT_LON}
FENCE = [[47.29, 8.49], [47.31, 8.49], [47.31, 8.52], [47.29, 8.52]]


def test_a_survey_polygon_is_the_area_also_inside_a_fence(tmp_path):
    mission = {"items": [SURVEY, {"type": "SimpleItem"}]}
    alone = read(tmp_path, plan(mission=mission), "a.plan")
    np.testing.assert_array_equal(alone.area, AREA)
    assert alone.ignored == ["1 x waypoint"]
    fence = {"polygons": [{"polygon": FENCE, "inclusion": True}]}
    inside = read(tmp_path, plan(mission=mission, geoFence=fence), "a.plan")
    np.testing.assert_array_equal(inside.area, AREA)
    assert "fence 1 (the area lies inside)" in inside.ignored
    fence["polygons"][0]["polygon"] = [[lat + 0.012, lon] for lat, lon in FENCE]
    with pytest.raises(ParameterError, match="may be the operating area: 'fence 1', 'survey 1'"):
        read(tmp_path, plan(mission=mission, geoFence=fence), "a.plan")


def test_a_circle_to_stay_in_reaches_nowhere_beyond_it(tmp_path):
    circle = {"inclusion": True, "circle": {"center": [47.304, 8.505], "radius": 200.0}}
    area = read(tmp_path, plan(geoFence={"circles": [circle]}), "a.plan").area
    distance_m = np.hypot(*local_from_geodetic(area[:, 0], area[:, 1], 47.304, 8.505))
    np.testing.assert_allclose(distance_m, 200.0, atol=1e-5)


def wpl(*rows):
    lines = ["QGC WPL 110"]
    for number, (command, value, lat, lon) in enumerate(rows):
        lines.append(f"{number}\t0\t3\t{command}\t{value}\t0\t0\t0\t{lat}\t{lon}\t0\t1")
    return "\n".join(lines)


def test_fences_of_mission_planner_are_area_and_no_go(tmp_path):
    inside = [(5001, 4, lat, lon) for lat, lon in LAT_LON]
    outside = [(5002, 3, y, x) for x, y in PIER[:3]]
    content = read(
        tmp_path,
        wpl((16, 0, 47.3, 8.5), *inside, *outside, (5004, 20.0, 47.304, 8.507), (5100, 0, 47.301, 8.501)),
        "fence.waypoints",
    )
    np.testing.assert_array_equal(content.area, AREA)
    assert list(content.no_go) == ["no_go_fence_2", "no_go_circle_3"]
    assert content.recoveries == {0: (47.301, 8.501)}
    assert content.ignored == ["1 x waypoint"]
    with pytest.raises(ParameterError, match="fence 1 has 3 of 4 corners"):
        read(tmp_path, wpl(*inside[:3], *outside), "fence.waypoints")


@pytest.mark.parametrize(("name", "first"), [("a.poly", []), ("a.fen", [[47.302, 8.504]])])
def test_corner_lists_of_mission_planner_are_the_area(tmp_path, name, first):
    lines = [f"{lat}\t{lon}" for lat, lon in [*first, *LAT_LON]]
    content = read(tmp_path, "#saved by Mission Planner 1.3\r\n" + "\r\n".join(lines), name)
    np.testing.assert_array_equal(content.area, AREA)


def test_a_fence_that_mavproxy_saved_begins_with_its_return_point(tmp_path):
    """It has no header and any suffix; the fence is closed, its return point lies inside."""
    lines = [f"{lat:.6f}\t{lon:.6f}" for lat, lon in [[47.302, 8.504], *LAT_LON, LAT_LON[0]]]
    content = read(tmp_path, "\n".join(lines) + "\n", "fence.txt")
    np.testing.assert_array_equal(content.area, AREA)
    assert content.ignored == ["fence return point"]


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("a.poly", "47,302 8,504"),
        ("a.poly", "47,302, 8,504"),
        ("a.poly", "47,302,8,504"),
        ("a.fen", "47.302 8,504"),
        ("a.ral", "RALLY 47,302 8,504 100 40 0 0"),
    ],
)
def test_decimal_commas_of_mission_planner_are_refused(tmp_path, name, line):
    with pytest.raises(
        ParameterError, match=r"a\.\w+:2: .* has decimal commas; write decimal points, such as 46\.5 6\.6"
    ):
        read(tmp_path, f"#saved\n{line}\n", name)


@pytest.mark.parametrize("line", ["47.302,8.504", "47.302, 8.504, 100", "47.302 8.504 100,0", "47,8"])
def test_commas_between_numbers_of_mission_planner_separate_them(tmp_path, line):
    content = read(tmp_path, f"{line}\n47.302 8.505\n47.303 8.505\n", "a.poly")
    assert content.area[0].tolist() == ([47.0, 8.0] if line == "47,8" else [47.302, 8.504])


@pytest.mark.parametrize(("stated", "is_inside"), [("false", False), ("true", True), (0, False), (False, False)])
@pytest.mark.parametrize("kind", ["polygons", "circles"])
def test_whether_a_fence_is_an_inclusion_may_be_a_text(tmp_path, stated, is_inside, kind):
    shape = {"polygon": FENCE} if kind == "polygons" else {"circle": {"center": [47.304, 8.505], "radius": 200.0}}
    content = read(tmp_path, json.dumps({"geoFence": {kind: [{**shape, "inclusion": stated}]}}), "a.plan")
    assert (content.area is not None) == is_inside
    assert bool(content.no_go) != is_inside
    with pytest.raises(ParameterError, match=r"inclusion is 'maybe'; write true or false"):
        read(tmp_path, json.dumps({"geoFence": {kind: [{**shape, "inclusion": "maybe"}]}}), "a.plan")


def random_zones(rng):
    """One area and other zones, each (name, rings): the outer ring and 0 to 3 holes."""
    names = ["Bay", *rng.choice(["no-go", "NoGo_1", "island", "shore", "Exclusion"], rng.integers(0, 8))]
    zones = []
    for name in names:
        at = rng.uniform((8.50, 47.30), (8.51, 47.31), (1 + rng.integers(0, 4), 2))
        square = np.array([[0.0, 0.0], [1e-4, 0.0], [1e-4, 1e-4], [0.0, 0.0]])
        zones.append((str(name), [(corner + square).tolist() for corner in at]))
    return [zones[k] for k in rng.permutation(len(zones))]


def random_kml(zones, rng):
    """KML with several holes in one boundary or each in its own, some polygons in folders or MultiGeometry."""
    parts = []
    for name, (outer, *holes) in zones:
        rings = [f"<LinearRing><coordinates>{corners(ring)}</coordinates></LinearRing>" for ring in (outer, *holes)]
        together = [rings[1:]] if rng.random() < 0.5 and holes else [[ring] for ring in rings[1:]]
        inner = "".join(f"<innerBoundaryIs>{''.join(group)}</innerBoundaryIs>" for group in together)
        shape = f"<Polygon><outerBoundaryIs>{rings[0]}</outerBoundaryIs>{inner}</Polygon>"
        shape = f"<MultiGeometry>{shape}</MultiGeometry>" if rng.random() < 0.3 else shape
        part = placemark(name, shape)
        parts.append(f"<Folder><name>x</name>{part}</Folder>" if rng.random() < 0.3 else part)
    return document("".join(parts))


def random_geojson(zones, rng):
    features = []
    for name, rings in zones:
        kind, places = ("Polygon", rings) if rng.random() < 0.5 else ("MultiPolygon", [rings])
        geometry = {"type": kind, "coordinates": places}
        geometry = {"type": "GeometryCollection", "geometries": [geometry]} if rng.random() < 0.3 else geometry
        features.append({"type": "Feature", "properties": {"Name": name}, "geometry": geometry})
    return json.dumps({"type": "FeatureCollection", "features": features})


def test_every_ring_is_used_or_named(tmp_path):
    """Rings counted by a regular expression and by shapely equal those used plus the holes named as ignored."""
    import shapely

    rng = np.random.default_rng(7)
    for _ in range(150):
        zones = random_zones(rng)
        kml, geojson = random_kml(zones, rng), random_geojson(zones, rng)
        polygons = [shapely.from_geojson(json.dumps(f["geometry"])) for f in json.loads(geojson)["features"]]
        for _depth in range(2):
            polygons = shapely.get_parts(polygons)
        independent = len(polygons) + int(shapely.get_num_interior_rings(polygons).sum())
        counts = {"a.kml": len(re.findall("<LinearRing>", kml)), "a.geojson": independent}
        for name, text in (("a.kml", kml), ("a.geojson", geojson)):
            content = read(tmp_path, text, name)
            holes = [text for text in content.ignored if text.startswith("hole ")]
            assert len(holes) == len(content.ignored)
            assert counts[name] == 1 + len(content.no_go) + len(content.shores) + len(holes)


def dms(degrees):
    return f"{int(degrees)}°{60.0 * (degrees % 1.0):.5f}'"


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("lat,lon", "{lat},{lon}"),
        ("Longitude;Latitude", "{lon_comma};{lat_comma}"),
        ("", "{lat_dms}N,{lon_dms}E"),
        ("# corners of the lake", "E {lon}; N {lat}"),
        ("Point\tLatitude\tLongitude", "{number}\t{lat_dms}N\t{lon_dms}E"),
    ],
)
def test_a_table_of_corners_is_the_area(tmp_path, header, row):
    rows = [
        row.format(
            number=number,
            lat=lat,
            lon=lon,
            lat_comma=str(lat).replace(".", ","),
            lon_comma=str(lon).replace(".", ","),
            lat_dms=dms(lat),
            lon_dms=dms(lon),
        )
        for number, (lon, lat) in enumerate(LAKE, 1)
    ]
    (tmp_path / "corners.csv").write_text("\n".join([header, *rows, ""]))
    found = read_area(tmp_path / "corners.csv")
    assert found.area == pytest.approx(AREA, abs=1e-6)
    assert found.ignored == (["column Point"] if "Point" in header else [])


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("lat,lon,depth\n47.3,8.5,3\n47.3,8.6,3\n47.4,8.6,4\n", r"table of soundings \(column depth\)"),
        ("lat,lon\n47.3,8.5\n47.3,east\n47.4,8.6\n", r"table\.csv:3: lon is 'east'"),
        ("lat,lon\n47.3,O 8.5\n47.3,O 8.6\n47.4,O 8.6\n", "east in German and west in French"),
        (
            "area,lat,lon\n" + "".join(f"{n},47.{3 + n}{i % 2},8.{5 + i // 2}\n" for n in (1, 2) for i in range(3)),
            "column area tells 2 areas apart",
        ),
        (
            '<osm version="0.6"><node id="1" lat="47" lon="8"/></osm>',
            r"an OpenStreetMap file\. .* area\.geojson \S+ multipolygons$",
        ),
        ("east,north\n1,2\n3,4\n5,7\n", "not a known kind of area file"),
        (
            "47.3 8.5\n47.3 8.6\n47.4 8.6\n",
            r"rows of numbers, such as 47\.3 8\.5, and no header\. Write .* lat,lon or lon,lat",
        ),
        ("47.3N 8.5E\n8.6E 47.3N\n47.4N 8.6E\n", "a table of corners with columns lat and lon"),
        ("lat,lon\n47.3,8.5\n47.3,8.6\n", r"table\.csv has 2 corners\. Write at least three"),
        ("lat,lon\n47.3,8.5\n47.3\n47.4,8.6\n", r"table\.csv:3: 1 field '47\.3', but the header has 2"),
    ],
)
def test_a_table_that_is_no_list_of_corners_is_refused(tmp_path, text, problem):
    (tmp_path / "table.csv").write_text(text)
    with pytest.raises(ParameterError, match=problem):
        read_area(tmp_path / "table.csv")


def test_an_error_lists_the_first_of_many_polygons(tmp_path):
    def band(n):
        ring = [[8.0, 47.0], [8.01 + 1e-4 * n, 47.0], [8.01, 47.01], [8.0, 47.0]]
        geometry = {"type": "Polygon", "coordinates": [ring]}
        return {"type": "Feature", "geometry": geometry, "properties": {"name": f"band {n}"}}

    data = json.dumps({"type": "FeatureCollection", "features": [band(n) for n in range(200)]})
    with pytest.raises(ParameterError, match=r"200 polygons may be .*: 'band 0', .*, 'band 7' and 192 more\."):
        read(tmp_path, data, "a.geojson")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('{"type": "FeatureCollection"}', r"a\.geojson is a FeatureCollection without a list of features"),
        ('{"type": "FeatureCollection", "features": {}}', "without a list of features"),
        ('{"type": "FeatureCollection", "features": [7]}', "feature 1 is 7, not an object"),
        ('{"type": "FeatureCollection", "features": [null]}', "feature 1 is null"),
        ('{"type": "Polygon"}', r"'feature 1' has the geometry {\"type\": \"Polygon\"}, which is not GeoJSON\. Export"),
        (
            '{"type": "Polygon", "coordinates": [[1, 2], [3, 4]]}',
            r"'feature 1' has the geometry .*\[\[1, 2\], \[3, 4\]\]",
        ),
        ('{"type": "Feature", "geometry": 3, "properties": {"name": "Bay"}}', "'Bay' has the geometry 3, which is"),
        ('{"type": "Feature", "geometry": {"type": "Point", "coordinates": ["x", 3]}}', "which is not GeoJSON"),
        ('{"type": "Polygon", "coordinates": [[[8, 47], [8', r"a\.geojson is not valid JSON: .* line 1 column 49"),
    ],
)
def test_a_geojson_with_a_fault_names_its_feature(tmp_path, text, problem):
    with pytest.raises(ParameterError, match=problem) as raised:
        read(tmp_path, text, "a.geojson")
    assert "Error:" not in str(raised.value)


def test_ignored_features_of_one_name_are_counted(tmp_path):
    points = placemark("mark", "<Point><coordinates>8.5,47.3</coordinates></Point>") * 12
    with pytest.raises(ParameterError, match="has no polygon, only 12 x 'mark'"):
        read(tmp_path, document(points))


def test_measures_of_a_line_are_not_worth_a_warning(tmp_path, recwarn):
    path = gdal_file(tmp_path, "a.gpkg", lakes={"Bay": LAKE})
    with sqlite3.connect(path) as database:  # pyogrio reads measures, but does not write them
        database.execute("UPDATE gpkg_geometry_columns SET m = 1")
    np.testing.assert_array_equal(read_area(path).area, AREA)
    assert not recwarn.list
