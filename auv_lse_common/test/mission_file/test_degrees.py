"""Areas, starts and recovery positions in degrees in a mission file."""

from __future__ import annotations

import pytest

from auv_lse_common.mission_file.parameter_file import read_parameter_file
from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.settings import Settings


def mission(tmp_path, text):
    path = tmp_path / "mission.yaml"
    path.write_text(text)
    return path


def test_mission_file_gives_positions_in_degrees(tmp_path):
    path = mission(
        tmp_path,
        "/**:\n  ros__parameters:\n    area: {origin_lat_deg: 47.3, origin_lon_deg: 8.5,\n"
        "      polygon_deg: [47.3, 8.5, 47.305, 8.5, 47.305, 8.508],\n"
        "      no_go_deg: {pier: [47.302, 8.501, 47.303, 8.501, 47.303, 8.502]}}\n"
        "    vehicle.recovery_deg: [47.301, 8.501]\n"
        "/auv2/**:\n  ros__parameters:\n    vehicle: {start_deg: [47.304, 8.502]}\n",
    )
    settings = Settings.load(path)
    assert settings.area.polygon_m[:2] == (0.0, 0.0)
    assert list(settings.area.no_go) == ["pier"]
    assert settings.vehicle(1).vehicle.recovery_north_m == pytest.approx(111.2, abs=0.1)
    assert settings.vehicle(2).vehicle.start_north_m == pytest.approx(444.8, abs=0.1)
    assert settings.vehicle(1).vehicle.start_north_m == 0.0


def test_degrees_are_converted_about_an_origin_on_top_of_the_file(tmp_path):
    polygon = "polygon_deg: [47.3, 8.5, 47.305, 8.5, 47.305, 8.508]"
    text = f"/**:\n  ros__parameters:\n    area: {{origin_lat_deg: 47.3, origin_lon_deg: 8.5, {polygon}}}\n"
    settings = Settings.load(mission(tmp_path, text), {"area.origin_lat_deg": 47.299})
    assert settings.area.origin_lat_deg == 47.299
    assert settings.area.polygon_m[:2] == pytest.approx((111.2, 0.0), abs=0.1)


@pytest.mark.parametrize(
    ("area", "expected"),
    [
        (
            "{polygon_deg: [47.3, 8.5, 47.4, 8.5, 47.4, 8.6], polygon_m: [0.0, 0.0, 9.0, 0.0, 1.0]}",
            "area.polygon_deg are both",
        ),
        ("{polygon_deg: [47.3, 8.5, 47.4]}", "area.polygon_deg has 3 numbers"),
        ("{polygon_deg: 3}", "area.polygon_deg must be a list of latitude.*, not 3"),
        ("{polygon_deg: [1%s, 8.5]}" % (400 * "0"), "area.polygon_deg must be"),
        ("{polygon_deg: [47.3, 8.5], origin_lat_deg: .nan, origin_lon_deg: 8.5}", "area.origin_.*latitude nan"),
        ("{polygon_deg: [47.3, 8.5], origin_lat_deg: 95.0, origin_lon_deg: 8.5}", "area.origin_.*latitude 95"),
        (
            "{polygon_deg: [47.3, 8.5], no_go: 5, no_go_deg: {pier: [47.3, 8.5]}}",
            "area.no_go must map names to corners, not 5",
        ),
        ("{file: 3}", "area.file is 3; write the name"),
        ("{no_go_deg: [1.0]}", "area.no_go_deg"),
        (
            "{polygon_m: [0.0, 0.0, 9.0, 0.0, 9.0, 9.0], no_go_deg: {pier: [47.3, 8.5, 47.3, 8.6, 47.4, 8.6]}}",
            "need area.origin_lat_deg and area.origin_lon_deg, .*; give both$",
        ),
        (
            "{polygon_m: [0.0, 0.0, 9.0, 0.0, 9.0, 9.0], no_go_deg: {a: [1.0, 1.0]}, origin_lat_deg: a}",
            "need area.origin_lat_deg .*; they are 'a' and None$",
        ),
    ],
)
def test_impossible_positions_name_their_key(tmp_path, area, expected):
    path = mission(tmp_path, f"/**:\n  ros__parameters:\n    area: {area}\n")
    with pytest.raises(ParameterError, match=expected) as error:
        read_parameter_file(path)
    assert str(path) in str(error.value)


def test_nodes_take_metres_only():
    with pytest.raises(ParameterError, match="take metres only"):
        AreaConfig(file="lake.kml")


def test_a_vehicle_refuses_an_area_file_and_names_the_command_that_writes_it(tmp_path):
    path = mission(tmp_path, "/**:\n  ros__parameters:\n    area: {file: lake.kml}\n")
    with pytest.raises(ParameterError, match=r"names lake.kml, .*auv_lse mission mission.yaml --for-vehicles"):
        read_parameter_file(path)
