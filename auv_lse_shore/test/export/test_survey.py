"""A made-up lake whose answers are known: water level, sound speed, uncertainties and orders, and the chart's files."""

import copy
import dataclasses
import json
import re
import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest
from pyproj import Transformer
from verb_main import verb_main

from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_record.run_writer import write_run
from auv_lse_shore.export.content import Export
from auv_lse_shore.export.export import write_export
from auv_lse_shore.export.formats import contours, crowdsourced, soundings_csv
from auv_lse_shore.export.formats.geotiff import rasterio
from auv_lse_shore.export.options import _water_level
from auv_lse_shore.export.projected import target_crs
from auv_lse_shore.export.survey import Survey, SurveyError, true_depth_m, vehicle_depth_m
from auv_lse_shore.export.uncertainty import ORDERS, cell_tvu_m, orders_met, sounding_uncertainty
from auv_lse_shore.judge.team_map import team_map
from auv_lse_sim.ground.ground_files import load_ground

main = verb_main("export")

ORIGIN = (46.5, 6.6)
#: The lake's surface sinks by 0.4 m in 20 minutes; its water is slower than the sounder assumed.
WATER_LEVEL = "time_s,level_m\n0,372.4\n1200,372.0\n"
PROFILE = "depth_m,sound_speed_mps\n0,1480\n40,1440\n"
DATUM = "LN02 (372 m)"


def recorded(run):
    """The run as it would be recorded in that lake: depths below the moment's surface, as the sounder computed them."""
    run = copy.deepcopy(run)
    for vehicle in run.vehicles:
        s, z0 = vehicle.soundings, vehicle_depth_m(run, vehicle)
        below_surface = s.depth_m + np.interp(s.stamp_s, [0.0, 1200.0], [0.4, 0.0])
        travel_s = -np.log((1480.0 - below_surface) / (1480.0 - z0))  # c = 1480 - z: integral of 1 / c from z0
        vehicle.soundings = dataclasses.replace(s, depth_m=z0 + 1500.0 * travel_s)
    return run


@pytest.fixture(scope="module")
def lake(tmp_path_factory, synthetic_run):
    """The export of that recording, and the map of the true depths."""
    run = synthetic_run(steps=12)
    run.ground = None
    run.parameters["/**"]["area"].update(origin_lat_deg=ORIGIN[0], origin_lon_deg=ORIGIN[1])
    folder = tmp_path_factory.mktemp("lake") / "run"
    write_run(recorded(run), folder)
    (folder / "level.csv").write_text(WATER_LEVEL.replace("372.", "0."))
    (folder / "profile.csv").write_text(PROFILE)
    level, profile = str(folder / "level.csv"), str(folder / "profile.csv")
    options = ["--contours", "12,99", "--contour-interval", "5", "--datum", DATUM]
    assert main([str(folder), "--water-level", level, "--sound-speed", profile, *options]) == 0
    return folder / "export", team_map(dataclasses.replace(run, origin=ORIGIN))


def test_depths_are_reduced_to_the_datum(lake):
    folder, team = lake
    depths = np.loadtxt(folder / "soundings.csv", delimiter=",", skiprows=1, usecols=4)
    true = np.concatenate([v.soundings.rows[:, [0, 3]] for v in team.run.vehicles])
    # Both are in order of time; two vehicles share stamps, so each time's depths are compared in order.
    times = np.loadtxt(folder / "soundings.csv", delimiter=",", skiprows=1, usecols=0)
    seen, expected = np.column_stack([times, depths]), true
    for rows in (seen, expected):
        rows[:] = rows[np.lexsort((rows[:, 1], rows[:, 0].round(3)))]
    np.testing.assert_allclose(seen[:, 1], expected[:, 1], atol=2e-3)
    with rasterio().open(folder / "depth.tif") as file:
        np.testing.assert_allclose(file.read(1)[::-1], team.field.mean_m, atol=0.02)


def test_the_chart_in_utm_is_the_map_as_cloud_optimized_geotiff_and_bag(lake):
    folder, team = lake
    grid = team.field.grid
    to_utm = Transformer.from_crs(team_crs(folder), "EPSG:32632", always_xy=True)
    rows, columns = np.nonzero(grid.inside)
    inner = (rows > 3) & (rows < rows.max() - 3) & (columns > 3) & (columns < columns.max() - 3)
    rows, columns = rows[inner][::37], columns[inner][::37]
    locations = np.column_stack(to_utm.transform(grid.east_m[columns], grid.north_m[rows]))
    survey_tvu = cell_tvu_m(team, Survey(sound_speed=np.array([[0.0, 1460.0]])))[rows, columns]
    for name, sign in (("chart.tif", 1.0), ("chart.bag", -1.0)):
        with rasterio().open(folder / name) as file:
            assert "UTM zone 32N" in file.crs.to_wkt()
            values = np.array(list(file.sample(locations)))
            known = np.array(file.nodata) != values[:, 0]
            assert known.all()
            # Sampled at the nearest of cells of 6 m, on a slope of 1 in 15
            np.testing.assert_allclose(sign * values[:, 0], team.field.mean_m[rows, columns], atol=0.35)
            assert np.median(values[:, 1] / survey_tvu) == pytest.approx(1.0, abs=0.05)
            if name == "chart.tif":
                assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
                assert file.tags()["vertical_datum"] == DATUM
                expected = orders_met(np.zeros(len(values)), values[:, 1], values[:, 0])
                np.testing.assert_array_equal(values[:, 2], expected)
            else:
                assert file.driver == "BAG"
                assert file.descriptions == ("elevation", "uncertainty")
                assert f'VERT_DATUM["{DATUM}"'.upper() in file.crs.to_wkt()  # rasterio passes capitals
                assert 'AXIS["HEIGHT",UP]' in file.crs.to_wkt()
                assert "0 TO 0.4 M ABOVE THE DATUM (LEVEL.CSV)" in file.tags(ns="xml:BAG")["xml:BAG"]


def team_crs(folder):
    with rasterio().open(folder / "depth.tif") as file:
        return file.crs.to_wkt()


def test_levels_beyond_the_largest_number_are_thinned_out_and_reported(lake, tmp_path):
    _, team = lake
    text = contours.write(Export(team=team, folder=tmp_path, survey=Survey(contour_interval_m=1e-4)))
    assert "--contour-interval gives more than 1000, so one in " in text
    assert len(json.loads((tmp_path / "contours.geojson").read_text())["features"]) <= contours.MAX_LEVELS


def test_contours_lie_on_their_depth(lake):
    folder, team = lake
    features = json.loads((folder / "contours.geojson").read_text())["features"]
    levels = [feature["properties"]["depth_m"] for feature in features]
    assert {12.0, 10.0, 15.0} <= set(levels)
    assert 99.0 not in levels
    assert levels == sorted(levels)
    transformer = Transformer.from_crs("EPSG:4326", team_crs(folder), always_xy=True)
    grid = team.field.grid
    for feature in features:
        for line in feature["geometry"]["coordinates"]:
            east, north = np.array(transformer.transform(*np.array(line).T))
            row = np.abs(grid.north_m[:, None] - north).argmin(axis=0)
            column = np.abs(grid.east_m[:, None] - east).argmin(axis=0)
            apart = team.field.mean_m[row, column] - feature["properties"]["depth_m"]
            assert np.nanmedian(np.abs(apart)) < 0.3


def test_every_file_that_can_records_datum_and_corrections(lake):
    folder, _ = lake
    words = json.loads((folder / "metadata.json").read_text())
    assert words["vertical_datum"] == DATUM
    assert words["sound_speed"] == "1440 to 1480 m/s (profile.csv)"
    assert re.fullmatch(r"\d+ soundings, simulated or without dates", words["soundings"])
    assert "Edition 6.1.0" in words["s44"]
    for name in ("isobath.geojson", "contours.geojson"):
        assert json.loads((folder / name).read_text())["metadata"].items() <= words.items()
    assert DATUM in (folder / "isobath.kml").read_text()
    for name in ("depth.tif", "std.tif", "risk.tif"):
        with rasterio().open(folder / name) as file:
            assert file.tags()["water_level"] == words["water_level"]


@pytest.mark.parametrize(
    ("thu", "tvu", "depth", "order"),
    [
        (1.0, 0.1677, 10.0, "exclusive"),  # sqrt(0.15^2 + 0.075^2) = 0.16771
        (1.0, 0.1678, 10.0, "special"),
        (1.01, 0.10, 10.0, "special"),
        (5.5, 0.516, 10.0, "1a/1b"),  # THU 5 + 0.5; sqrt(0.5^2 + 0.13^2) = 0.5166
        (5.51, 0.516, 10.0, "2"),
        (21.0, 1.0, 10.0, "2"),  # sqrt(1 + 0.23^2) = 1.026
        (21.01, 1.0, 10.0, "none"),
        (float("nan"), 0.1, 10.0, "none"),
    ],
)
def test_orders_of_s44(thu, tvu, depth, order):
    assert ORDERS[orders_met(np.array([thu]), np.array([tvu]), np.array([depth]))[0]].name == order


@pytest.mark.parametrize(("north", "east", "correlation"), [(1.0, 1.0, 0.0), (2.0, 0.5, 0.0), (1.0, 1.0, 0.99)])
def test_a_sounding_lies_within_its_thu_in_at_least_95_of_100_cases(synthetic_run, north, east, correlation):
    run = synthetic_run(steps=2)
    vehicle = run.vehicles[0]
    vehicle.position_std_m = np.tile([north, east], (len(vehicle.odometry), 1))
    found = sounding_uncertainty(run, vehicle, Survey(), noise_std_m=0.2)
    cross = correlation * north * east
    draws = np.random.default_rng(1).multivariate_normal([0, 0], [[north**2, cross], [cross, east**2]], 20_000)
    within = (np.hypot(*draws.T) <= found.thu_m[0]).mean()
    assert 0.945 < within < 0.985
    # Hand-worked: sounder 0.2, pressure 0.05, water level 0.05, and 5 / 1500 of the range
    range_m = vehicle.soundings.depth_m[0] - vehicle_depth_m(run, vehicle)[0]
    variance = 0.2**2 + 2 * 0.05**2 + (range_m * 5.0 / 1500.0) ** 2
    assert found.tvu_m[0] == pytest.approx(1.96 * np.sqrt(variance), rel=1e-9)


def test_a_constant_sound_speed_scales_the_range():
    depth, vehicle = np.array([13.0, 33.0, 2.0]), np.array([3.0, 3.0, 3.0])
    corrected = true_depth_m(depth, vehicle, np.array([[0.0, 1450.0]]), 1500.0)
    # 10 and 30 m of range become 9.667 and 29 m; a depth above the vehicle has no range.
    np.testing.assert_allclose(corrected, [12.6667, 32.0, 2.0], atol=1e-3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--water-level", "0.3"], "--water-level needs --datum"),
        (["--water-level", "LEVEL", "--datum", "D"], r"covers only 0 s to 10 s, but the soundings are from"),
        (["--sound-speed", "15"], "must be within 1000 to 2000 m/s"),
        (["--sound-speed", "LEVEL"], r"has the columns time_s, level_m; needed is a CSV file with columns depth_m"),
        (["--std", "sounder=x"], "--std: sounder=x is not NAME=VALUE"),
        (["--contours", "5,deep"], "--contours: 5,deep cannot be used"),
        (["--sound-speed", "15"], "not 15$"),
        (["--sounder-speed", "1480"], "--sounder-speed 1480 corrects depths only together with --sound-speed"),
        (["--crs", "EPSG:1"], "--crs: EPSG:1 is not a coordinate system"),
        (["--crs", "EPSG:5773"], "--crs: EPSG:5773 has no horizontal coordinates"),
        (["--origin", "146", "-37"], "--origin: latitude 146, longitude -37 is not .* Are they swapped"),
        (["--origin", "nan", "7"], "--origin: latitude nan, longitude 7 is not a position in degrees.$"),
        (["--origin", "46", "7"], "--origin: the mission has one, 46.5, 6.6 deg; leave it out"),
        (["--provider", " ", "a@b.ch"], "--provider: ' ', 'a@b.ch' are not a name and an e-mail address"),
        (["--provider", "A", "b.ch"], "--provider: 'A', 'b.ch' are not a name and an e-mail address"),
        (["--contour-interval", "-1"], "must be more than 0 m"),
        (["--contour-interval", "0"], "--contour-interval must be more than 0 m, not 0"),
    ],
)
def test_corrections_that_cannot_be_used_are_named(lake, tmp_path, capsys, options, message):
    (tmp_path / "level.csv").write_text("time_s,level_m\n0,0.1\n10,0.2\n")
    options = [option.replace("LEVEL", str(tmp_path / "level.csv")) for option in options]
    assert main([str(lake[0].parent), "--out", str(tmp_path / "out"), *options]) == 2
    assert re.search(message, capsys.readouterr().err)


@pytest.mark.parametrize(
    ("option", "text", "message"),
    [
        (
            "--water-level",
            "time_s,level_m\n0,1\n5,-9999\n9,1\n",
            r":3: level_m is '-9999'. This is a common mark .* Remove this line",
        ),
        (
            "--water-level",
            "time_utc,level_m\n14.06.2026 09:00,1\n",
            r":2: time_utc is '14.06.2026 09:00'. Write a time such",
        ),
        ("--water-level", "time_s,level_m\n0,high\n", r":2: level_m is 'high'. Write a finite number"),
        ("--water-level", "time_s,level_m\n0,0,1\n9,0,2\n", r":2: 3 fields '0,0,1', but the header has 2"),
        (
            "--water-level",
            "time_s,level_m\n0,0.1\n9,0.2\n0,0.3\n",
            r":4: level_m is 0\.3 at the same time_s as in .*:2, where it is 0\.1\. Remove one",
        ),
        (
            "--water-level",
            "time_s,level_m\n0,0.1\n5,-99\n9,0.2\n",
            r":3: level_m is -99, far from the others and a common mark .* Remove this line",
        ),
        (
            "--water-level",
            "time_s,level_m\n0,-99\n500,-99\n900,0.2\n",
            r":2: level_m is -99, far from the others and a common mark .* Remove this line",
        ),
        (
            "--water-level",
            "time_s,level_m\n0,-99\n500,-99\n",
            r"table.csv has only levels of -99, a common mark .* as a number: --water-level -99",
        ),
        ("--water-level", "time_s,level_m\n0,-999.9\n", r"only levels of -999.9, a common mark"),
        ("--water-level", "time_s,level_m\n", r"table.csv has 1 line; write a header, then rows"),
        (
            "--sound-speed",
            "depth_m,sound_speed_mps\n-50,1440\n0,1480\n",
            r":2: depth_m is '-50'. Write depths positive down",
        ),
    ],
)
def test_tables_that_would_be_misread_are_refused(tmp_path, capsys, lake, option, text, message):
    (tmp_path / "table.csv").write_text(text)
    options = [option, str(tmp_path / "table.csv"), "--datum", "D", "--out", str(tmp_path / "out")]
    assert main([str(lake[0].parent), *options]) == 2
    assert re.search(message, capsys.readouterr().err)


@pytest.mark.parametrize(
    "text",
    [
        "time_s,level_m\n9,0.2\n0,0.1\n5,0.4\n",  # newest first
        "time_s,level_m\n0,0.1\n5,0.4\n5,0.40\n9,0.2\n",
        "time_s;level_m;name\n0;0,1;a,b\n5;0,4;c\n9;0.2;d\n",
        "time_s\tlevel_m\n0\t0.1\n5\t0.4\n9\t0.2\n",
        "\ufeff time_s, level_m\n0, 0.1\n5, 0.4\n9, 0.2\n",
        'time_s,level_m,"quality; source"\n0,0.1,good\n5,0.4,good\n9,0.2,good\n',
        'time_s,Level (m)\n0,"0,1"\n5,"0,4"\n9,"0,2"\n',
        "time_s;level_m;\n0;0,1;\n5;0,4;\n9;0,2;\n;;\n;;\n",  # empty rows of a spreadsheet
    ],
)
def test_tables_of_gauges_and_spreadsheets_are_read(tmp_path, text):
    (tmp_path / "level.csv").write_text(text)
    np.testing.assert_array_equal(_water_level(str(tmp_path / "level.csv")), [(0.0, 0.1), (5.0, 0.4), (9.0, 0.2)])


@pytest.mark.parametrize(
    "levels", [(98.9, 99.0, 99.9), (99.0, 99.0, 99.0), (-98.0, -99.0, -99.0), (-98.5, -98.5, -98.5)]
)
def test_a_lake_whose_level_is_99_m_from_the_datum_is_no_missing_data(tmp_path, levels):
    (tmp_path / "level.csv").write_text("time_s,level_m\n" + "".join(f"{5 * i},{x}\n" for i, x in enumerate(levels)))
    assert len(_water_level(str(tmp_path / "level.csv"))) == 3


def test_the_range_of_reduced_depths_and_soundings_above_the_datum_are_reported(lake, tmp_path, capsys):
    """A level in centimetres puts all of them there."""
    options = ["--datum", "D", "--out", str(tmp_path / "out"), "--water-level"]
    assert main([str(lake[0].parent), *options, "12"]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"^depths: -\d+\.\d to \d+\.\d m below D$", printed, re.MULTILINE)
    assert re.search(r"^\d+ of 576 soundings lie above D and are not mapped$", printed, re.MULTILINE)
    assert main([str(lake[0].parent), *options, "120"]) == 2
    message = r"--water-level of 120 m \(constant\) puts all 576 soundings above D, by \d+\.\d to \d+\.\d m\. Give"
    said = capsys.readouterr().err
    assert re.search(message, said)
    assert 'such as --datum "D 120 m" --water-level 0' in said
    assert main([str(lake[0].parent), *options[2:], "120", "--datum", "D 120 m"]) == 2
    assert 'such as --datum "D 120 m" --water-level 0' in capsys.readouterr().err
    assert main([str(lake[0].parent), *options[2:], "0", "--datum", "D 120 m"]) == 0
    (tmp_path / "level.csv").write_text("time_s,level_m\n0,120.4\n9000,120.1\n")
    assert main([str(lake[0].parent), *options, str(tmp_path / "level.csv")]) == 2
    assert 'such as --datum "D 120 m" and a table of levels 120 m lower' in capsys.readouterr().err


def test_soundings_are_written_a_few_at_a_time(lake, tmp_path):
    run = copy.deepcopy(lake[1].run)
    count, first = 60_000, run.vehicles[0]
    rows = np.column_stack([np.linspace(1.8e9, 1.81e9, count), np.zeros((count, 2)), np.full(count, 9.0)])
    many = dataclasses.replace(first, soundings=Soundings.from_rows(rows))
    survey = Survey(provider=("Lake Lab", "lab@lake.org"))
    team = dataclasses.replace(lake[1], run=dataclasses.replace(run, vehicles=[many]))
    export = Export(team=team, folder=tmp_path, survey=survey)
    for module in (crowdsourced, soundings_csv):
        tracemalloc.start()
        assert module.write(export)
        _, peak_bytes = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak_bytes < 500 * count  # as arrays: 7 to 20 numbers of each; as Python's, 700 to 2,000 bytes
    assert len(json.loads((tmp_path / "soundings_b12_auv1.geojson").read_text())["features"]) == count
    assert (tmp_path / "soundings.csv").read_text().count("\n") == count + 1


def test_s102_is_read_back_by_gdal(lake):
    """With GDAL's driver, which shares no code with the writer; and as ground of a mission."""
    h5py = pytest.importorskip("h5py")
    folder, _ = lake
    with h5py.File(folder / "chart_s102.h5") as file:
        assert "simulated or without dates" in file.attrs["soundings"]
    with rasterio().open(folder / "chart.tif") as tif, rasterio().open(folder / "chart_s102.h5", driver="S102") as file:
        assert file.descriptions == ("depth", "uncertainty")
        assert file.crs.to_epsg(confidence_threshold=20) == 32632 or "UTM zone 32N" in file.crs.to_wkt()
        np.testing.assert_allclose(file.transform[:6], tif.transform[:6], rtol=1e-9)
        depth, tvu = file.read(masked=True)
        expected = tif.read(masked=True)
    np.testing.assert_array_equal(np.ma.getmaskarray(depth), np.ma.getmaskarray(expected[0]))
    np.testing.assert_allclose(depth.compressed(), expected[0].compressed(), rtol=1e-6)
    np.testing.assert_allclose(tvu.compressed(), expected[1].compressed(), rtol=1e-6)
    ground = load_ground(folder / "chart_s102.h5")
    assert "depth positive down; band 1 of 2 (depth)" in ground.describe()


@pytest.mark.parametrize(
    ("datum", "meaning"),
    [("IGLD 85", "internationalGreatLakesDatum1985"), ("mllw", "meanLowerLowWater"), ("LN02 372 m", "localDatum")],
)
def test_s102_has_the_code_of_a_known_datum(lake, tmp_path, datum, meaning):
    lines = " ".join(write_export(lake[1], tmp_path, Survey(datum=datum)))
    with rasterio().open(tmp_path / "chart_s102.h5", driver="S102") as file:
        assert file.tags()["VERTICAL_DATUM_MEANING"] == meaning
    assert ("a local datum" in lines) == (meaning == "localDatum")


def test_another_projection_and_degrees(lake, tmp_path):
    _, team = lake
    for crs, bag in (("EPSG:2056", True), ("EPSG:4326", False)):
        said = list(write_export(team, tmp_path, Survey(crs=crs)))
        assert (tmp_path / "chart.bag").exists() == bag
        assert (tmp_path / "chart_s102.h5").exists() != bag  # S-102 allows UTM and degrees
        assert any(f"({crs}" in line for line in said)
        with rasterio().open(tmp_path / "chart.tif") as file:
            assert file.crs.to_epsg() == int(crs[5:])
            assert file.tags()["vertical_datum"] == "water surface during the dive"


@pytest.fixture
def for_b12(lake, tmp_path):
    """An export whose times are UTC, as those of vehicles are."""
    run = copy.deepcopy(lake[1].run)
    for vehicle in run.vehicles:
        vehicle.soundings = dataclasses.replace(vehicle.soundings, stamp_s=vehicle.soundings.stamp_s + 1.8e9)
        vehicle.odometry[:, 0] += 1.8e9
    survey = Survey(
        provider=("Lake Lab", "lab@lake.org"), water_level=np.array([[0.0, 0.5]]), datum=DATUM,
        sound_speed=np.array([[0.0, 1450.0]]),
    )  # fmt: skip
    return Export(team=dataclasses.replace(lake[1], run=run), folder=tmp_path, survey=survey)


def test_metadata_tell_when_soundings_were_taken(for_b12):
    assert re.fullmatch(r"\d+ soundings from 2027-01-15T08:\S+Z to 2027-01-15T\S+Z", for_b12.metadata()["soundings"])


def test_crowdsourced_bathymetry_follows_b12(for_b12):
    export, tmp_path, run = for_b12, for_b12.folder, for_b12.team.run
    assert crowdsourced.write(export) == "soundings_b12_auvN.geojson (2 vehicles, GeoJSON CSB 3.1)"
    text = (tmp_path / "soundings_b12_auv2.geojson").read_text()
    collection = json.loads(text)
    vessel = collection["properties"]["trustedNode"]["uniqueVesselID"]
    assert re.fullmatch(r"LakeLab-[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", vessel)
    assert collection["properties"]["processing"][2]["datum"] == DATUM
    first, sounding = collection["features"][0], run.vehicles[1].soundings
    assert first["properties"]["depth"] == pytest.approx(sounding.depth_m[0], abs=6e-4)
    assert re.fullmatch(r"2027-01-15T08:00:0\d\.\d{3}Z", first["properties"]["time"])
    assert len(first["properties"]["uncertainty"]) == 3
    assert first["geometry"]["coordinates"] == pytest.approx([ORIGIN[1], ORIGIN[0]], abs=0.01)
    assert collection["properties"]["platform"]["type"] == "autonomous underwater vehicle"
    run.vehicles[1].decisions.clear()  # as of an imported log, which may be a boat's
    crowdsourced.write(export)
    assert "type" not in json.loads((tmp_path / "soundings_b12_auv2.geojson").read_text())["properties"]["platform"]
    assert crowdsourced.write(dataclasses.replace(export, survey=Survey())).endswith("EMAIL is not given")
    assert not list(tmp_path.glob("*.geojson"))


def test_the_published_schema_accepts_it(for_b12):
    validator = pytest.importorskip("csbschema", reason="needs csbschema (pip install csbschema)")
    crowdsourced.write(for_b12)
    valid, result = validator.validate_data(for_b12.folder / "soundings_b12_auv1.geojson")
    assert valid, result


@pytest.mark.parametrize(("hours", "noted"), [(24, True), (1, False)])
def test_levels_between_which_a_tide_could_pass_are_noted(lake, tmp_path, capsys, hours, noted):
    table = tmp_path / "levels.csv"
    table.write_text("time_s,level_m\n" + "".join(f"{3600 * hours * (day - 1)},0.{day}\n" for day in range(4)))
    options = ["--datum", "D", "--out", str(tmp_path / "out"), "--water-level", str(table)]
    assert main([str(lake[0].parent), *options]) == 0
    note = "water levels are interpolated over 24 h; a tide between them would be missed"
    assert (note in capsys.readouterr().out) == noted


def test_a_water_level_needs_a_datum():
    with pytest.raises(SurveyError, match="needs --datum"):
        Survey(water_level=np.array([[0.0, 1.0]]))


def test_a_gap_between_water_levels_is_refused_if_soundings_lie_in_it():
    stamps = np.append(np.arange(0.0, 3600.0, 600.0), np.arange(36_000.0, 39_601.0, 600.0))
    survey = Survey(water_level=np.column_stack([stamps, stamps / 36_000.0]), datum="D")
    assert survey.water_level_at(np.array([900.0, 37_000.0])) == pytest.approx([0.025, 1.0278], abs=1e-4)
    with pytest.raises(SurveyError, match=r"no level from 3000 s to 36000 s, .* 600 s apart, and 2 soundings"):
        survey.water_level_at(np.array([900.0, 4000.0, 30_000.0, 37_000.0]))
    filled = np.append(np.arange(0.0, 7200.0, 360.0), np.arange(7200.0, 25_201.0, 3600.0))  # with hourly predictions
    hourly = Survey(water_level=np.column_stack([filled, filled / 36_000.0]), datum="D")
    assert hourly.water_level_at(np.array([9000.0])) == pytest.approx([0.25])
    utc = Survey(water_level=np.column_stack([1.8e9 + stamps, stamps]), datum="D")
    with pytest.raises(SurveyError, match=r"no level from 2027-01-15T08:50:00Z to 2027-01-15T18:00:00Z"):
        utc.water_level_at(1.8e9 + np.array([4000.0]))


@pytest.mark.parametrize(
    ("latitude", "longitude", "code"),
    [
        (46.5, 6.6, 32632),
        (-45.0, 5.9999, 32731),
        (83.9, -179.9, 32601),
        (85.0, 20.0, 5041),  # under the ice: UTM ends at 84 degrees north
        (-79.9, 180.0, 32701),
        (-80.5, 166.0, 5042),
    ],
)
def test_a_chart_near_a_pole_is_in_its_polar_projection(latitude, longitude, code):
    pytest.importorskip("rasterio")
    export = SimpleNamespace(reference=SimpleNamespace(origin=(latitude, longitude)), survey=SimpleNamespace(crs=None))
    assert target_crs(export).to_epsg(confidence_threshold=20) == code
