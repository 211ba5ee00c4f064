"""isobath.kml and isobath.plan, read as Google Earth, QGroundControl and this project read them."""

import dataclasses
import itertools
import json
from xml.etree import ElementTree

import numpy as np
import pytest

from auv_lse_common.vocabulary.frames import local_from_geodetic
from auv_lse_shore.areas.area_file import read_area
from auv_lse_shore.export.content import Export
from auv_lse_shore.export.formats import kml, qgc_plan
from auv_lse_shore.judge.team_map import team_map

ORIGIN = (46.5, 6.6)
PIER = [20.0, 20.0, 20.0, 40.0, 40.0, 40.0]
KML = {"k": "http://www.opengis.net/kml/2.2"}


@pytest.fixture(scope="module")
def export(tmp_path_factory, synthetic_run):
    run = synthetic_run(steps=12)
    run.ground = None
    run.parameters["/**"]["area"] = {**run.parameters["/**"]["area"], "no_go": {"pier & <crane>": PIER}}
    run.parameters["/**"]["vehicle"] = {"recovery_north_m": 10.0, "recovery_east_m": 15.0}
    run.origin = ORIGIN
    content = Export(team=team_map(run), folder=tmp_path_factory.mktemp("export"))
    assert kml.write(content).startswith("isobath.kml (")
    assert " waypoints " in qgc_plan.write(content)
    return content


def local(locations):
    """Locations (n, 2) north, east (m) of rows of latitude, longitude (deg)."""
    return np.column_stack(local_from_geodetic(*np.array(locations, dtype=float).T[:2], *ORIGIN))


def kml_line(placemark):
    text = placemark.find("k:LineString/k:coordinates", KML).text
    return local([[float(x) for x in location.split(",")][::-1] for location in text.split()])


def longest_found(export):
    return max((p for p in export.team.pieces if p.kind == "found"), key=lambda p: p.length_m)


def test_the_kml_has_every_piece_with_its_class_and_style(export):
    root = ElementTree.parse(export.folder / "isobath.kml").getroot()
    assert root.tag == f"{{{KML['k']}}}kml"
    document = root.find("k:Document", KML)
    styles = {f"#{style.get('id')}" for style in document.findall("k:Style", KML)}
    by_folder = {f.findtext("k:name", namespaces=KML): f.findall("k:Placemark", KML) for f in document.iter() if
                 f.tag.endswith("Folder")}  # fmt: skip
    for kind in ("found", "likely", "guessed"):
        lines = sorted((kml_line(p) for p in by_folder[f"isobath, {kind}"]), key=len)
        expected = sorted((p.line for p in export.team.pieces if p.kind == kind), key=len)
        assert [len(line) for line in lines] == [len(line) for line in expected]
        assert all(p.findtext("k:styleUrl", namespaces=KML) in styles for p in by_folder[f"isobath, {kind}"])
    np.testing.assert_allclose(kml_line(by_folder["isobath, found"][0]), longest_found(export).line, atol=0.02)
    area, pier = by_folder["operating area"]
    np.testing.assert_allclose(kml_line(area)[:-1], export.team.area.polygon, atol=0.02)
    assert pier.findtext("k:name", namespaces=KML) == "pier & <crane>"
    assert by_folder["95 % band"]


def test_qgroundcontrol_imports_the_longest_piece_of_the_kml(export):
    """It takes the first Polygon anywhere in the file if there is one, else the first LineString."""
    root = ElementTree.parse(export.folder / "isobath.kml").getroot()
    assert root.find(".//k:Polygon", KML) is None
    first = next(p for p in root.iter(f"{{{KML['k']}}}Placemark"))
    np.testing.assert_allclose(kml_line(first), longest_found(export).line, atol=0.02)


def test_gdal_reads_the_kml(export):
    pyogrio = pytest.importorskip("pyogrio")
    names = [name for name, _ in pyogrio.list_layers(export.folder / "isobath.kml")]
    assert "isobath, found" in names
    info = pyogrio.read_info(export.folder / "isobath.kml", layer="isobath, found")
    assert info["crs"] == "EPSG:4326"
    assert info["features"] == sum(p.kind == "found" for p in export.team.pieces)


def test_the_plan_has_what_qgroundcontrol_requires(export):
    """Keys and types of its plan file format, version 1 (mission 2, geofence 2, rally points 2)."""
    plan = json.loads((export.folder / "isobath.plan").read_text())
    assert (plan["fileType"], plan["version"], plan["groundStation"]) == ("Plan", 1, "QGroundControl")
    versions = {part: plan[part]["version"] for part in ("mission", "geoFence", "rallyPoints")}
    assert versions == {"mission": 2, "geoFence": 2, "rallyPoints": 2}
    mission = plan["mission"]
    assert (mission["firmwareType"], mission["vehicleType"]) == (3, 11)
    assert len(mission["plannedHomePosition"]) == 3
    for number, item in enumerate(mission["items"], 1):
        assert (item["type"], item["command"], item["frame"]) == ("SimpleItem", 16, 3)
        assert item["doJumpId"] == number
        assert item["autoContinue"] is True
        assert len(item["params"]) == 7
    way = local([item["params"][4:6] for item in mission["items"]])
    line = longest_found(export).line
    np.testing.assert_allclose(way[[0, -1]], line[[0, -1]], atol=0.02)
    assert 2 <= len(way) < len(line)
    fine = np.vstack([a + (b - a) * np.linspace(0, 1, 50)[:, None] for a, b in itertools.pairwise(way)])
    gaps = np.hypot(*(line[:, None] - fine[None]).transpose(2, 0, 1)).min(axis=1)
    assert gaps.max() < qgc_plan.TOLERANCE_M + 0.5
    area, pier = plan["geoFence"]["polygons"]
    assert (area["inclusion"], pier["inclusion"]) == (True, False)
    np.testing.assert_allclose(local(area["polygon"]), export.team.area.polygon, atol=0.02)
    np.testing.assert_allclose(local(pier["polygon"]), np.reshape(PIER, (-1, 2)), atol=0.02)
    np.testing.assert_allclose(local(plan["rallyPoints"]["points"]), [[10.0, 15.0]], atol=0.02)


def test_the_plan_is_the_area_of_another_mission(export):
    locations = read_area(export.folder / "isobath.plan")
    np.testing.assert_allclose(local(locations.area), export.team.area.polygon, atol=0.02)
    assert len(locations.no_go) == 1
    np.testing.assert_allclose(local([locations.recoveries[0]]), [[10.0, 15.0]], atol=0.02)


def test_without_an_origin_both_say_what_is_missing_and_leave_no_old_file(export, tmp_path):
    bare = dataclasses.replace(export.team, run=dataclasses.replace(export.team.run, origin=None))
    for module, name in ((kml, "isobath.kml"), (qgc_plan, "isobath.plan")):
        (tmp_path / name).write_text("old")
        assert "because the mission has no origin; give" in module.write(Export(team=bare, folder=tmp_path))
        assert not (tmp_path / name).exists()


def test_both_count_what_they_hold(export, tmp_path):
    for pieces, in_kml, in_plan in (
        ([], "(0 pieces)", "(the area alone: no piece is found)"),
        ([longest_found(export)], "(1 piece)", "waypoints along the longest piece found)"),
    ):
        content = Export(team=dataclasses.replace(export.team, pieces=pieces), folder=tmp_path)
        assert kml.write(content).endswith(in_kml)
        assert qgc_plan.write(content).endswith(in_plan)
