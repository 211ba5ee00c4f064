"""Every ring and zone of a file of positions is used, refused by name, or listed as ignored."""

from __future__ import annotations

import json

import pytest

from auv_lse_common.mission_file.parameter_file import read_parameter_file
from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_shore.areas.area_file import read_area

LAKE = [[8.500, 47.300], [8.508, 47.300], [8.508, 47.305], [8.500, 47.305], [8.500, 47.300]]
ISLANDS = [
    [[8.501 + d, 47.302], [8.502 + d, 47.302], [8.502 + d, 47.303], [8.501 + d, 47.302]] for d in (0, 2e-3, 4e-3)
]
METRES = "polygon_m: [0.0, 0.0, 900.0, 0.0, 900.0, 900.0], origin_lat_deg: 47.3, origin_lon_deg: 8.5"


def geojson(path, *features):
    """Writes features (properties, kind, coordinates)."""
    made = [
        {"type": "Feature", "properties": known, "geometry": {"type": kind, "coordinates": positions}}
        for known, kind, positions in features
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": made}))
    return path


def kml(path, *placemarks):
    path.write_text(
        '<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document>'
        + "".join(f"<Placemark>{placemark}</Placemark>" for placemark in placemarks)
        + "</Document></kml>"
    )
    return path


def ring(positions):
    return "<LinearRing><coordinates>" + " ".join(f"{x},{y},3" for x, y in positions) + "</coordinates></LinearRing>"


def boundary(side, *rings):
    return f"<{side}BoundaryIs>{''.join(map(ring, rings))}</{side}BoundaryIs>"


def mission(tmp_path, area):
    path = tmp_path / "mission.yaml"
    path.write_text(f"/**:\n  ros__parameters:\n    area: {{{area}}}\n")
    return path


def test_several_rings_in_one_inner_boundary_are_all_no_go(tmp_path):
    path = kml(
        tmp_path / "a.kml",
        f"<name>Survey</name><Polygon>{boundary('outer', LAKE)}{boundary('inner', *ISLANDS)}</Polygon>",
    )
    positions = read_area(path)
    assert [ring[0, 1] for ring in positions.no_go.values()] == [island[0][0] for island in ISLANDS]


def test_a_second_outer_ring_is_refused(tmp_path):
    path = kml(tmp_path / "a.kml", f"<name>Survey</name><Polygon>{boundary('outer', LAKE, ISLANDS[0])}</Polygon>")
    with pytest.raises(ParameterError, match="'Survey' has 2 outer rings"):
        read_area(path)


def test_a_ring_without_a_polygon_is_used(tmp_path):
    lake = f"<name>lake</name><Polygon>{boundary('outer', LAKE)}</Polygon>"
    path = kml(
        tmp_path / "a.kml", lake, f"<name>no-go pier</name>{ring(ISLANDS[0])}", f"<name>no-go</name>{ring(ISLANDS[1])}"
    )
    positions = read_area(path)
    assert list(positions.no_go) == ["no_go_pier", "no_go"]


@pytest.mark.parametrize(
    "known",
    [
        {"Name": "no-go rock", "Type": "Exclusive"},
        {"Name": "rock", "Type": "Exclusive"},
        {"NAME": "no_go_1"},
        {"label": "NoGo1"},
        {"name": "KeepOut"},
        {"Title": "Exclusion_2"},
        {"name": "the islands"},
        {"name": "x", "class": "restricted"},
        {"name": "x", "no_go": True, "type": "polygon"},
        {"name": "x", "exclude": 1},
        {"name": "x", "inclusion": False},
        {"name": "x", "no_go": "Y"},
        {"name": "x", "exclusion": "x"},
        {"name": "x", "inclusion": "N"},
        {"name": "Sperrzone 2"},
        {"name": "zone interdite"},
        {"name": "zona prohibida"},
        {"name": "do not enter"},
        {"name": "rocks"},
        {"name": "MPA closed area"},
        {"name": "exclusion"},
        {"name": "keep out"},
        {"name": "Sperrgebiet"},
        {"name": "Gesperrter Bereich"},
        {"name": "Insel"},
        {"name": "INSELN 2"},
        {"name": "Felsen"},
        {"name": "Île"},
        {"name": "i\u0302le"},
        {"name": "les îlots"},
        {"name": "rochers"},
        {"name": "zone fermée"},
        {"name": "Isla"},
        {"name": "obstáculo"},
        {"name": "zona de exclusión"},
        {"name": "Isola"},
        {"name": "scogli"},
        {"name": "ilha"},
        {"name": "área de exclusão"},
        {"name": "eiland"},
        {"name": "forbjudet område"},
        {"name": "förbjudet område"},
    ],
)
def test_a_no_go_area_is_recognized_however_it_is_written(tmp_path, known):
    path = geojson(tmp_path / "a.geojson", ({"name": "lake"}, "Polygon", [LAKE]), (known, "Polygon", [ISLANDS[0]]))
    assert len(read_area(path).no_go) == 1
    alone = geojson(tmp_path / "b.geojson", (known, "Polygon", [ISLANDS[0]]))
    assert read_area(alone).area is None
    with pytest.raises(ParameterError, match="no polygon is the operating area"):
        read_parameter_file(mission(tmp_path, "file: b.geojson, origin_lat_deg: 47.3, origin_lon_deg: 8.5"), read_area)


@pytest.mark.parametrize(
    "known",
    [
        {"name": "x", "description": "exclusion zone"},
        {"name": "no-go rock", "type": "inclusion"},
        {"name": "no-go rock", "inclusion": True},
        {"name": "x", "no_go_reason": "cable"},
        {"name": "x", "NoGo": 2},
    ],
)
@pytest.mark.parametrize(("kind", "positions"), [("Polygon", [LAKE]), ("LineString", LAKE)])
def test_a_zone_that_may_be_either_is_refused(tmp_path, known, kind, positions):
    path = geojson(tmp_path / "a.geojson", (known, kind, positions))
    with pytest.raises(ParameterError, match="Set its property role to 'area' or 'no-go'"):
        read_area(path)


@pytest.mark.parametrize(
    "known",
    [
        {"name": "Bay", "role": "area", "note": "avoid the island"},
        {"name": "Home lake"},
        {"name": "Bay", "islands": 3, "no_go": "N"},
        {"name": "Inselsee"},
        {"name": "Rocky Bay"},
        {"name": "track", "geometry": "closed", "closed": True},
    ],
)
def test_an_area_may_mention_other_things(tmp_path, known):
    assert read_area(geojson(tmp_path / "a.geojson", (known, "Polygon", [LAKE]))).area is not None


def test_an_unnamed_zone_beside_a_given_area_is_refused(tmp_path):
    geojson(tmp_path / "a.geojson", ({"name": "Zone 7"}, "Polygon", [ISLANDS[0]]))
    with pytest.raises(ParameterError, match=r"polygon_m is given, but the polygon 'Zone 7' .*Name a polygon 'no-go"):
        read_parameter_file(mission(tmp_path, f"file: a.geojson, {METRES}"), read_area)
    geojson(tmp_path / "a.geojson", ({"name": "no-go Zone 7"}, "Polygon", [ISLANDS[0]]))
    read = read_parameter_file(mission(tmp_path, f"file: a.geojson, {METRES}"), read_area)
    assert list(read["/**"]["area"]["no_go"]) == ["no_go_zone_7"]


def test_an_area_in_degrees_beside_a_file_is_refused(tmp_path):
    geojson(tmp_path / "a.geojson", ({"name": "no-go rock"}, "Polygon", [ISLANDS[0]]))
    degrees = "polygon_deg: [47.3, 8.5, 47.305, 8.5, 47.305, 8.508]"
    with pytest.raises(ParameterError, match=r"area.file and area.polygon_deg are both given.*no_go_deg"):
        read_parameter_file(mission(tmp_path, f"file: a.geojson, {degrees}"), read_area)


@pytest.mark.parametrize("given", ["no_go", "no_go_deg"])
def test_no_go_areas_of_one_name_are_all_kept(tmp_path, given):
    geojson(tmp_path / "a.geojson", ({"name": "island"}, "Polygon", [ISLANDS[0]]))
    corners = {"no_go": "[10.0, 10.0, 20.0, 10.0, 20.0, 20.0]", "no_go_deg": "[47.3, 8.5, 47.301, 8.5, 47.301, 8.501]"}
    text = f"file: a.geojson, {METRES}, {given}: {{island: {corners[given]}}}"
    assert list(read_parameter_file(mission(tmp_path, text), read_area)["/**"]["area"]["no_go"]) == [
        "island",
        "island_2",
    ]


@pytest.mark.parametrize(("kind", "positions"), [("Point", LAKE[0]), ("LineString", LAKE[:3])])
def test_a_no_go_area_that_encloses_nothing_is_refused(tmp_path, kind, positions):
    path = geojson(tmp_path / "a.geojson", ({"name": "lake"}, "Polygon", [LAKE]), ({"name": "no-go"}, kind, positions))
    with pytest.raises(ParameterError, match="a no-go area needs a polygon"):
        read_area(path)


def test_a_closed_line_is_a_no_go_area_and_its_holes_are_listed(tmp_path):
    lake = ({"name": "lake"}, "Polygon", [LAKE])
    positions = read_area(
        geojson(
            tmp_path / "a.geojson",
            lake,
            ({"name": "no-go pier"}, "LineString", ISLANDS[0]),
            ({"name": "no-go bay"}, "Polygon", [ISLANDS[1], ISLANDS[2]]),
            ({"name": "nothing"}, "Point", LAKE[0]),
        )
    )
    assert list(positions.no_go) == ["no_go_pier", "no_go_bay"]
    assert positions.ignored == ["hole 1 of no-go area no-go bay", "nothing"]


@pytest.mark.parametrize(
    "name",
    [
        "Forbidden Lake",
        "Small Island Lake",
        "Danger Reservoir",
        "Hazard pond 2025",
        "Lac de l'Île",
        "Lago Isola 2",
        "Lake of the Isles",
        "Rock Creek",
        "Island Bay",
    ],
)
def test_a_lake_may_be_called_after_islands_and_dangers(tmp_path, name):
    known = ({"name": "island"}, "Polygon", [ISLANDS[0]])
    path = geojson(tmp_path / "a.geojson", ({"name": name}, "Polygon", [LAKE]), known)
    content = read_area(path)
    assert content.area_name == name
    assert list(content.no_go) == ["island"]
    stated = geojson(tmp_path / "b.geojson", ({"name": f"no-go {name}"}, "Polygon", [ISLANDS[1]]), known)
    assert len(read_area(stated).no_go) == 2
