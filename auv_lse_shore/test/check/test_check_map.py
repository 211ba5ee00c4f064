"""auv_lse check --map and --area: what is drawn of a mission, and what is said of a file of positions."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
import shapely
from matplotlib import font_manager
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.patches import Polygon
from verb_main import verb_main

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.frames import local_from_geodetic
from auv_lse_common.vocabulary.naive_ids import FITTED
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_shore.areas.area_file import read_area
from auv_lse_shore.check.command import check
from auv_lse_shore.check.findings import Findings
from auv_lse_shore.check.geometry import check_geometry
from auv_lse_shore.check.map_picture import mission_figure
from auv_lse_shore.judge.planned_paths import PlannedPaths
from auv_lse_shore.report.figures import STYLE, cjk_fonts, save

main = verb_main("check")

MISSION = """\
/**:
  ros__parameters:
    mission: {vehicles: 2, steps: 20}
    area: {file: lake.geojson}
"""
RING = [[8.500, 47.300], [8.505, 47.300], [8.505, 47.304], [8.500, 47.304], [8.500, 47.300]]
PIER = [[8.502, 47.302], [8.503, 47.302], [8.503, 47.303], [8.502, 47.302]]


def feature(name, kind, coordinates):
    return {"type": "Feature", "properties": {"name": name}, "geometry": {"type": kind, "coordinates": coordinates}}


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    features = [
        feature("lake", "Polygon", [RING]),
        feature("no-go pier", "Polygon", [PIER]),
        feature("start 1", "Point", [8.501, 47.301]),
        feature("start 2", "Point", [8.5015, 47.301]),
        feature("recovery", "Point", [8.4995, 47.301]),  # on the shore
        feature("harbor", "Point", [8.5, 47.3]),
    ]
    (tmp_path / "lake.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    (tmp_path / "mission.yaml").write_text(MISSION)
    return tmp_path / "mission.yaml"


def test_what_was_used_of_a_file_of_positions_and_what_was_not_is_reported(mission: Path) -> None:
    notes = "\n".join(text for level, text in check(mission).rows if level == "note")
    assert "lake.geojson: used the area 'lake', no-go area no_go_pier, start of auv1, start of auv2, recovery" in notes
    assert "lake.geojson: ignored 'harbor'" in notes


def test_positions_of_a_file_that_do_not_apply_are_not_among_the_used_ones(mission: Path) -> None:
    own = "/auv1/**: {ros__parameters: {vehicle: {start_north_m: 200.0, start_east_m: 200.0}}}\n"
    mission.write_text(MISSION.replace("vehicles: 2", "vehicles: 1") + own)
    notes = "\n".join(text for level, text in check(mission).rows if level == "note")
    assert "used the area 'lake', no-go area no_go_pier, recovery position of all vehicles\n" in notes
    assert "lake.geojson: the start of auv1 is that of the mission file (/auv1/**)" in notes
    assert "lake.geojson: ignored start of auv2: the mission has 1 vehicle" in notes


@pytest.mark.parametrize(
    "given", ["vehicle: {start_north_m: 200.0, start_east_m: 200.0}", "vehicle.start_east_m: 200.0"]
)
def test_a_start_of_all_vehicles_in_the_mission_file_replaces_those_of_the_area_file(mission: Path, given: str) -> None:
    first, mark, rest = MISSION.partition("ros__parameters:\n")
    mission.write_text(f"{first}{mark}    {given}\n{rest}")
    settings = Settings.load(mission, read_area=read_area)
    assert {own.vehicle.start_east_m for own in settings.vehicles} == {200.0}
    notes = "\n".join(text for level, text in check(mission).rows if level == "note")
    for number in (1, 2):
        assert f"lake.geojson: the start of auv{number} is that of the mission file (/**)" in notes


def test_the_map_shows_the_positions_where_they_are(mission: Path) -> None:
    settings = Settings.load(mission, read_area=read_area)
    origin = settings.area.origin_lat_deg, settings.area.origin_lon_deg
    figure = mission_figure(settings, "a mission", ["ignored 'harbor'"])
    (axis,) = figure.axes
    drawn = [patch.get_xy()[:-1, ::-1] for patch in axis.patches if isinstance(patch, Polygon)]
    for ring, seen in zip((RING, PIER), drawn, strict=True):
        lon, lat = np.array(ring[:-1]).T
        np.testing.assert_allclose(seen, np.column_stack(local_from_geodetic(lat, lon, *origin)), atol=0.02)
    words = [text.get_text() for text in axis.texts]
    assert {"auv1", "auv2", "recovery", "no_go_pier", "N", "100 m"} <= set(words)
    assert "ignored 'harbor'" in axis.get_title(loc="left")
    # The recovery position, outside of the area, is within the picture, and so are lines of latitude and longitude.
    low, high = axis.get_xlim()
    west = float(local_from_geodetic(47.301, 8.4995, *origin)[1])
    assert low < west < high
    labels = [
        (tick.get_text(), position)
        for side in axis.child_axes
        for of in (side.xaxis, side.yaxis)
        for tick, position in zip(of.get_ticklabels(), of.get_ticklocs(), strict=True)
    ]
    north = dict(labels)["47.302° N"]
    assert north == pytest.approx(float(local_from_geodetic(47.302, 8.5025, *origin)[0]), abs=0.1)
    east = dict(labels)["8.502° E"]
    assert east == pytest.approx(float(local_from_geodetic(47.304, 8.502, *origin)[1]), abs=0.2)


def test_area_replaces_that_of_the_mission_file_and_the_map_has_its_name(
    mission: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["--area", "lake.geojson", "--map"]) == 1  # the default start of auv3 is in the no-go area
    assert Path("lake-map.png").read_bytes()[:4] == b"\x89PNG"
    assert "no-go area no_go_pier" in capsys.readouterr().out


def test_a_picture_that_cannot_be_written_is_named(
    mission: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    assert main([str(mission), "--map", str(tmp_path / "file" / "map.png")]) == 2
    assert capsys.readouterr().err == f"error    {tmp_path}/file/map.png: Not a directory\n"


def test_a_mission_file_is_never_taken_for_the_name_of_the_picture(
    mission: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["--map", str(mission)])
    assert "does not end in .png. If it is the mission file, give it first" in capsys.readouterr().err
    assert mission.read_text() == MISSION


def test_a_mission_with_an_impossible_area_is_not_drawn(mission: Path, tmp_path: Path) -> None:
    mission.write_text(MISSION.replace("file: lake.geojson", "polygon_m: [0.0, 0.0, 9.0, 9.0, 9.0, 0.0, 0.0, 9.0]"))
    rows = check(mission, picture=tmp_path / "no.png").rows
    assert any("is not drawn; correct the errors" in text for _, text in rows)
    assert not (tmp_path / "no.png").exists()


def test_ground_that_cannot_be_reached_is_reported_and_drawn_apart_from_no_go_areas(tmp_path: Path) -> None:
    basins = [(0, 0), (0, 150), (150, 150), (150, 88), (170, 88), (170, 150), (320, 150), (320, 0), (170, 0), (170, 62)]
    flat = [float(x) for corner in [*basins, (150, 62), (150, 0)] for x in corner]
    path = tmp_path / "gate.yaml"
    path.write_text(
        "/**:\n  ros__parameters:\n    mission: {vehicles: 1, steps: 20}\n"
        f"    area: {{polygon_m: {flat}}}\n    vehicle: {{start_north_m: 60.0, start_east_m: 60.0}}\n"
    )
    findings = Findings()
    settings = check_geometry(Settings.load(path), findings)
    (text,) = (text for level, text in findings.rows if level == "warning" and "cannot be reached" in text)
    assert "50 % of it (2.3 ha)" in text
    assert "coverage: 1 vehicle x 20 steps, 0.5 km of path in 0.02 km2" in " ".join(text for _, text in findings.rows)
    figure = mission_figure(settings, "a gate")
    assert [text.get_text() for text in figure.legends[0].get_texts()].count("cannot be reached") == 1
    assert "no-go area" not in [text.get_text() for text in figure.legends[0].get_texts()]
    drawn = [patch for patch in figure.axes[0].patches if isinstance(patch, Polygon) and patch.get_hatch() == "...."]
    assert [patch.get_xy()[:, 1].min() for patch in drawn] == pytest.approx([170.0], abs=5.0)


@pytest.mark.parametrize(("islands", "named"), [(2, 2), (12, 0)])
def test_the_names_of_many_no_go_areas_do_not_cover_the_map(tmp_path: Path, islands: int, named: int) -> None:
    no_go = {f"rock_{k}": [40.0 * k, 300.0, 40.0 * k, 310.0, 40.0 * k + 10.0, 300.0] for k in range(1, islands + 1)}
    path = tmp_path / "rocks.yaml"
    path.write_text(f"/**:\n  ros__parameters:\n    area: {{no_go: {no_go}}}\n")
    figure = mission_figure(Settings.load(path), "rocks")
    assert sum("rock" in text.get_text() for text in figure.axes[0].texts) == named


@pytest.mark.parametrize("along_north", [True, False])
def test_the_map_of_a_river_is_stretched_across(along_north: bool) -> None:
    high = (3000.0, 80.0) if along_north else (80.0, 3000.0)
    polygon = [0.0, 0.0, high[0], 0.0, *high, 0.0, high[1]]
    start = {"vehicle.start_north_m": 0.5 * high[0], "vehicle.start_east_m": 0.5 * high[1]}
    figure = mission_figure(Settings.load(None, {"area.polygon_m": polygon, "mission.vehicles": 1, **start}), "river")
    FigureCanvasAgg(figure).draw()
    (axis,) = figure.axes
    box = axis.get_window_extent()
    sides = sorted((box.width, box.height))
    assert sides[1] / sides[0] == pytest.approx(4.0, rel=0.1)
    assert f"{'east' if along_north else 'north'} (m),\nstretched" in (axis.get_xlabel() + axis.get_ylabel())
    arrow = next(text for text in axis.texts if text.arrow_patch is not None)
    ends = axis.transData.transform([arrow.xy, arrow.xyann])
    assert np.hypot(*(ends[1] - ends[0])) == pytest.approx(0.06 * box.width, rel=0.01)


def test_the_line_of_the_margin_is_where_the_margin_ends() -> None:
    polygon = [0.0, 0.0, 2000.0, 700.0, 1300.0, 2700.0, -700.0, 2000.0]  # oblique to the axes
    no_go = {"pier": [600.0, 600.0, 900.0, 640.0, 700.0, 900.0]}
    start = {"vehicle.start_north_m": 200.0, "vehicle.start_east_m": 200.0, "mission.vehicles": 1}
    settings = Settings.load(None, {"area.polygon_m": polygon, "area.no_go": no_go, **start})
    (axis,) = mission_figure(settings, "oblique").axes
    rings = [shapely.LinearRing(np.reshape(ring, (-1, 2))) for ring in (polygon, no_go["pier"])]
    lines = [line.get_xydata()[:, ::-1] for line in axis.lines if line.get_label() == "margin"]
    assert len(lines) == 2
    for line in lines:
        # a circle's arc is a chain of chords: 16 for each quarter, each 0.05 % of the radius inside
        assert shapely.distance(shapely.points(line), shapely.union_all(rings)) == pytest.approx(10.0, abs=0.02)


@pytest.mark.parametrize("straight", [True, False])
def test_legs_are_drawn_as_they_are_travelled(straight: bool) -> None:
    settings = Settings.load(None, {"mission.vehicles": 1, "mission.steps": 40, "motion.straight_legs": straight})
    (axis,) = mission_figure(settings, "arcs").axes
    rollout = PlannedPaths(settings.planner_settings(1), OperatingArea(settings.area)).rollout
    own = settings.vehicle(1).vehicle
    start = np.array([own.start_heading_rad, own.start_north_m, own.start_east_m])
    path = rollout.path(0, start, (), FITTED[0])
    motion, (c, s) = MotionTable(settings.motion), np.array([np.cos, np.sin])
    ways = []
    for state, action in zip(path.states[:-1], path.actions, strict=True):
        ahead, starboard = motion.tracks_m[action].T if not straight else np.array([[0, 0], motion.steps_m[action]]).T
        north = state[1] + c(state[0]) * ahead - s(state[0]) * starboard
        ways.append(np.column_stack([north, state[2] + s(state[0]) * ahead + c(state[0]) * starboard]))
    travelled = shapely.LineString(np.concatenate(ways))
    drawn = max((line.get_xydata()[:, ::-1] for line in axis.lines), key=len)
    # 8 chords of an arc of a quarter turn stray from it by 0.5 % of the radius, 15 m
    with np.errstate(invalid="ignore"):  # shapely of Ubuntu 24.04
        apart_m = shapely.hausdorff_distance(shapely.LineString(drawn), travelled, densify=0.1)
    assert apart_m < (1e-6 if straight else 0.08)


@pytest.mark.parametrize(("south", "west"), [(True, True), (True, False), (False, True), (False, False)])
def test_the_north_arrow_keeps_clear_of_starts(south: bool, west: bool) -> None:
    north, east = (30.0 if south else 470.0), (30.0 if west else 470.0)
    polygon = [0.0, 0.0, 500.0, 0.0, 500.0, 500.0, 0.0, 500.0]
    start = {"vehicle.start_north_m": north, "vehicle.start_east_m": east, "mission.vehicles": 1}
    figure = mission_figure(Settings.load(None, {"area.polygon_m": polygon, **start}), "corner")
    FigureCanvasAgg(figure).draw()
    (axis,) = figure.axes
    boxes = {text.get_text(): text.get_window_extent() for text in axis.texts if text.get_text()}
    assert not boxes["auv1"].overlaps(boxes["N"])
    assert not boxes["auv1"].overlaps(boxes["100 m"])
    arrow = axis.transData.transform([text.xy for text in axis.texts if text.get_text() == "N"])
    assert not boxes["auv1"].contains(*arrow[0])
    bar = max((line for line in axis.lines if line.get_marker() == "|"), key=lambda line: np.ptp(line.get_xdata()))
    off_m = np.array([side for xy in bar.get_xydata() for at in xy for side in (abs(at), abs(500.0 - at))])
    assert off_m.min() > 0.02 * 500.0, "the bar lies on no border"


def test_a_label_in_letters_that_no_font_has_warns_of_nothing(mission: Path, tmp_path: Path) -> None:
    settings = Settings.load(mission, {"area.no_go": {"\u6e56": [10.0, 10.0, 20.0, 10.0, 20.0, 20.0]}}, read_area)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        save(mission_figure(settings, "\u6e56", ["\u6e56"]), tmp_path / "map.png")
    assert (tmp_path / "map.png").is_file()


def test_fonts_with_chinese_japanese_and_korean_letters_are_used_where_they_are_installed() -> None:
    installed = ["DejaVu Sans", "Noto Sans CJK JP", "WenQuanYi Micro Hei", "Noto Sans CJK JP", "IPAGothic", "cmr10"]
    assert cjk_fonts(installed) == ["IPAGothic", "Noto Sans CJK JP", "WenQuanYi Micro Hei"]
    assert STYLE["font.family"] == ["DejaVu Sans", *cjk_fonts(font_manager.get_font_names())]
