"""What a mission found, for other programs: written, and read back by their libraries."""

import csv
import dataclasses
import errno
import json
import os
import resource
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image
from verb_main import verb_main

from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_common.vocabulary.frames import geodetic_from_local, local_from_geodetic
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_record.run_writer import write_run
from auv_lse_shore.export.content import NODATA, Export, ExportError
from auv_lse_shore.export.formats import ascii_grid, bag, cloud_geotiff, geotiff, s102, soundings_csv
from auv_lse_shore.export.formats.geotiff import rasterio
from auv_lse_shore.judge.team_map import team_map
from auv_lse_sim.ground.ascii_ground import read_ascii_ground
from auv_lse_sim.ground.gdal_ground import read_gdal_ground

main = verb_main("export")

ORIGIN = (46.5, 6.6)

#: A corner is cut off the area, so that the maps have cells outside of it, and north and east differ.
POLYGON = [0.0, 0.0, 240.0, 0.0, 240.0, 200.0, 150.0, 300.0, 0.0, 300.0]


def exported(tmp_path_factory, synthetic_run, origin):
    """The export of a run folder with blanks in its path, its run and its map."""
    run = synthetic_run(steps=12)
    run.ground = None
    run.parameters["/**"]["area"] = {**run.parameters["/**"]["area"], "polygon_m": POLYGON}
    if origin is not None:
        run.parameters["/**"]["area"].update(origin_lat_deg=origin[0], origin_lon_deg=origin[1])
    folder = tmp_path_factory.mktemp("an export") / "run one"
    write_run(run, folder)
    assert main([str(folder)]) == 0
    return folder / "export", run, team_map(run)


@pytest.fixture(scope="module")
def on_earth(tmp_path_factory, synthetic_run):
    return exported(tmp_path_factory, synthetic_run, ORIGIN)


@pytest.fixture(scope="module")
def local(tmp_path_factory, synthetic_run):
    return exported(tmp_path_factory, synthetic_run, None)


@pytest.mark.parametrize(("name", "attribute"), [("risk", "risk"), ("depth", "mean_m"), ("std", "std_m")])
@pytest.mark.parametrize("ending", ["tif", "asc"])
def test_rasters_are_read_back_by_rasterio(on_earth, name, attribute, ending):
    folder, _, team = on_earth
    with rasterio().open(folder / f"{name}.{ending}") as file:
        assert file.nodata == NODATA
        assert file.crs is not None
        assert file.transform.e < 0.0 < file.transform.a  # north up
        values = file.read(1, masked=True)
        at = {(i, j): file.xy(i, j) for i in (0, file.height - 1) for j in (0, file.width - 1)}
        crs = file.crs.to_wkt()
    grid = team.field.grid
    # The first row is the northernmost; x is east, y is north, at the cells' centers.
    assert at[0, 0] == pytest.approx((grid.east_m[0], grid.north_m[-1]))
    assert at[values.shape[0] - 1, values.shape[1] - 1] == pytest.approx((grid.east_m[-1], grid.north_m[0]))
    expected = getattr(team.field, attribute)[::-1]
    assert np.array_equal(values.mask, np.isnan(expected))
    assert values.mask.any()
    # float32 and seven digits of text
    np.testing.assert_allclose(values.compressed(), expected[~np.isnan(expected)], rtol=1e-6, atol=1e-6)
    from pyproj import Transformer

    lon, lat = Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform(120.0, 80.0)
    north, east = geodetic_from_local(80.0, 120.0, *ORIGIN)
    assert (lat, lon) == pytest.approx((float(north), float(east)), abs=1e-9)  # 0.1 mm


def test_units_and_coordinates_are_in_the_geotiff(on_earth, local):
    for (folder, _, _), words in ((on_earth, "metres about 46.500000, 6.600000 deg"), (local, "local metres")):
        with rasterio().open(folder / "depth.tif") as file:
            assert file.units == ("m",)
            assert file.descriptions == ("depth of water, positive down",)
            assert file.tags()["coordinates"].startswith(words)
    with rasterio().open(local[0] / "depth.tif") as file:
        assert file.crs is None
    assert not (local[0] / "depth.prj").exists()


@pytest.mark.parametrize(("ending", "read"), [("tif", read_gdal_ground), ("asc", read_ascii_ground)])
def test_an_exported_depth_map_is_ground_for_another_mission(on_earth, ending, read):
    folder, _, team = on_earth
    ground = read(folder / f"depth.{ending}", BathymetryConfig(), ORIGIN)
    field = team.field
    north, east = np.meshgrid(field.grid.north_m[5:-5:7], field.grid.east_m[5:-5:7], indexing="ij")
    depth = ground.depth_m(north, east)
    expected = field.mean_m[5:-5:7, 5:-5:7]
    both = np.isfinite(depth) & np.isfinite(expected)
    assert both.sum() > 20
    # The raster is resampled bilinearly and read by a spline: within 0.1 m on slopes of 1 in 15.
    np.testing.assert_allclose(depth[both], expected[both], atol=0.1)


def test_the_isobath_of_the_export_is_that_of_the_map(on_earth, local):
    for (folder, _, team), origin in ((on_earth, ORIGIN), (local, None)):
        features = json.loads((folder / "isobath.geojson").read_text())["features"]
        pieces = [f for f in features if f["properties"]["class"] in ("found", "likely", "guessed")]
        assert len(pieces) == len(team.pieces)
        assert {f["properties"]["class"] for f in features} >= {"found", "band"}
        first = min(pieces, key=lambda f: f["properties"]["class"] != "found")
        x, y = np.array(first["geometry"]["coordinates"][0]).T
        north, east = (y, x) if origin is None else local_from_geodetic(y, x, *origin)
        found = next(p for p in team.pieces if p.kind == "found")
        np.testing.assert_allclose(np.column_stack([north, east]), found.line, atol=0.02)  # 7 decimals are 1 cm
        assert first["properties"]["coordinates"].startswith("local metres" if origin is None else "WGS84")


def test_soundings_have_time_vehicle_location_and_its_error(on_earth, local):
    for (folder, run, _), origin in ((on_earth, ORIGIN), (local, None)):
        with (folder / "soundings.csv").open() as file:
            rows = list(csv.DictReader(file))
        assert len(rows) == sum(len(v.soundings) for v in run.vehicles)
        times = [float(row["time_s"]) for row in rows]
        assert times == sorted(times)
        assert ("latitude_deg" in rows[0]) == (origin is not None)
        for vehicle in run.vehicles:
            own = [row for row in rows if row["vehicle"] == str(vehicle.vehicle)]
            for column, values in (("time_s", 0), ("north_m", 1), ("east_m", 2), ("depth_m", 3)):
                np.testing.assert_allclose(
                    [float(r[column]) for r in own], vehicle.soundings.rows[:, values], atol=6e-4
                )
            std = vehicle.position_std_at(vehicle.soundings.stamp_s)
            np.testing.assert_allclose([float(r["north_std_m"]) for r in own], std[:, 0], atol=6e-4)
            np.testing.assert_allclose([float(r["east_std_m"]) for r in own], std[:, 1], atol=6e-4)
            if origin is not None:
                geodetic = [[float(r[c]) for r in own] for c in ("latitude_deg", "longitude_deg")]
                north, east = local_from_geodetic(*geodetic, *origin)
                np.testing.assert_allclose(np.column_stack([north, east]), vehicle.soundings.locations_m, atol=2e-3)


def test_a_position_error_that_is_not_known_is_left_empty(tmp_path, synthetic_run):
    run = synthetic_run(steps=2)
    for vehicle in run.vehicles:
        vehicle.position_std_m = np.empty((0, 2))
    write_run(run, tmp_path)
    assert main([str(tmp_path), "--out", str(tmp_path / "elsewhere")]) == 0
    with (tmp_path / "elsewhere" / "soundings.csv").open() as file:
        assert {(row["north_std_m"], row["east_std_m"]) for row in csv.DictReader(file)} == {("", "")}
    assert not (tmp_path / "export").exists()


def test_a_run_that_ended_before_its_first_sounding_is_exported(tmp_path, synthetic_run, capsys):
    run = synthetic_run(steps=2)
    for vehicle in run.vehicles:
        vehicle.soundings = vehicle.received = Soundings.from_rows([])
    write_run(run, tmp_path)
    assert main([str(tmp_path), "--water-level", "1.0", "--datum", "D", "--picture"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "depths: none was measured; the map shows the prior"


def test_the_qgis_project_names_the_files_beside_it(on_earth, local):
    """What QGIS reads of them is there, and every file that they name exists."""
    for (folder, _, _), crs in ((on_earth, "EPSG:4326"), (local, None)):
        project = ElementTree.parse(folder / "isobath.qgs").getroot()
        layers = project.findall("projectlayers/maplayer")
        ids = [layer.findtext("id") for layer in layers]
        assert ids == [layer.get("id") for layer in project.findall("layer-tree-group/layer-tree-layer")]
        assert all(len(name) > 10 for name in ids)  # QGIS replaces shorter ones, and then finds no layer
        for layer in layers:
            source = layer.findtext("datasource")
            assert source.startswith("./")
            assert (folder / source.split("?")[0]).is_file()
            assert (folder / source.split("?")[0]).with_suffix(".qml").is_file()
            assert (layer.find("pipe") is None) != (layer.find("renderer-v2") is None)
            if layer.get("type") == "vector":
                assert (layer.findtext("srs/spatialrefsys/authid") or None) == crs
        assert project.findtext("properties/SpatialRefSys/ProjectionsEnabled") == ("0" if crs is None else "1")
        for style in folder.glob("*.qml"):
            assert ElementTree.parse(style).getroot().tag == "qgis"


#: The system's Python, which sees QGIS where it is installed.
SYSTEM_PYTHON = ("/usr/bin/python3", "-E", "-s")


def has_qgis():
    try:
        return subprocess.run([*SYSTEM_PYTHON, "-c", "import qgis.core"], capture_output=True).returncode == 0
    except OSError:
        return False


@pytest.mark.skipif(not has_qgis(), reason="needs QGIS (Debian, Ubuntu: sudo apt install python3-qgis)")
@pytest.mark.parametrize("where", ["on_earth", "local"])
def test_qgis_itself_opens_and_draws_the_project(request, tmp_path, where):
    folder, run, team = request.getfixturevalue(where)
    program = Path(__file__).with_name("read_by_qgis.py")
    environment = {"PATH": "/usr/bin:/bin", "QT_QPA_PLATFORM": "offscreen", "HOME": str(tmp_path)}
    command = [*SYSTEM_PYTHON, str(program), str(folder / "isobath.qgs"), str(tmp_path / "seen.png")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=environment)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["read"]
    assert found["errors"] == []
    layers = {layer["name"]: layer for layer in found["layers"]}
    assert len(layers) == 5
    assert all(layer["valid"] for layer in layers.values()), layers
    assert {name for name, layer in layers.items() if layer["shown"]} == {
        "15 m isobath", "soundings", "Bayes risk (cost per location)"
    }  # fmt: skip
    assert layers["soundings"]["features"] == sum(len(v.soundings) for v in run.vehicles)
    grid = team.field.grid
    west, south = grid.east_m[0] - grid.resolution_m, grid.north_m[0] - grid.resolution_m
    east, north = grid.east_m[-1] + grid.resolution_m, grid.north_m[-1] + grid.resolution_m
    for name, layer in layers.items():
        x0, y0, x1, y1 = layer["extent"]
        assert west <= x0 < x1 <= east, f"{name} lies elsewhere: {layer}"
        assert south <= y0 < y1 <= north, f"{name} lies elsewhere: {layer}"
    seen = np.asarray(Image.open(tmp_path / "seen.png").convert("RGB")).reshape(-1, 3)
    assert len(np.unique(seen, axis=0)) > 20, "QGIS drew nothing"


def test_the_picture_is_made_from_the_files_alone(on_earth, tmp_path):
    from auv_lse_shore.export.picture import draw_export

    for name in ("risk.tif", "depth.tif", "std.tif", "isobath.geojson", "soundings.csv"):
        (tmp_path / name).write_bytes((on_earth[0] / name).read_bytes())
    draw_export(tmp_path, tmp_path / "export.png")
    assert (tmp_path / "export.png").read_bytes()[:4] == b"\x89PNG"


def test_a_second_export_replaces_the_first(on_earth, capsys):
    folder = on_earth[0]
    (folder / "depth.asc").write_text("old")
    assert main([str(folder.parent)]) == 0
    assert (folder / "depth.asc").read_text().startswith("ncols ")
    assert "coordinates: metres about 46.5" in capsys.readouterr().out


def test_a_mission_without_origin_gets_one_after_the_dive(tmp_path, local, capsys):
    """Not from the mission file beside the recording: changes there are reported and ignored."""
    folder, mission = local[0].parent, local[0].parent / "mission.yaml"
    text = mission.read_text()
    mission.write_text(text.replace("    area:\n", "    area:\n      origin_lat_deg: 1.0\n      origin_lon_deg: 2.0\n"))
    try:
        assert main([str(folder), "--out", str(tmp_path / "without")]) == 0
    finally:
        mission.write_text(text)
    said = capsys.readouterr().out
    assert f"{mission} is not the mission file in the recording and is ignored" in said
    assert "chart.tif: skipped, because the mission has no origin; give --origin LAT LON" in said
    assert main([str(folder), "--out", str(tmp_path / "with"), "--origin", "46.5", "6.6"]) == 0
    said = capsys.readouterr().out
    assert "coordinates: metres about 46.5" in said
    assert "ignored" not in said
    rows = list(csv.DictReader((tmp_path / "with" / "soundings.csv").open()))
    latitude, longitude = geodetic_from_local(float(rows[0]["north_m"]), float(rows[0]["east_m"]), 46.5, 6.6)
    assert float(rows[0]["latitude_deg"]) == pytest.approx(float(latitude))
    assert float(rows[0]["longitude_deg"]) == pytest.approx(float(longitude))


def test_a_map_without_origin_leaves_no_projection_of_an_earlier_one(tmp_path, on_earth):
    team = on_earth[2]
    for origin, there in ((ORIGIN, True), (None, False)):
        run = dataclasses.replace(team.run, origin=origin)
        ascii_grid.write(Export(team=dataclasses.replace(team, run=run), folder=tmp_path))
        assert (tmp_path / "depth.prj").exists() == there


def test_a_missing_library_is_named_with_its_install_command(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(ExportError, match=r"fix: pip install rasterio"):
        rasterio()
    assert main([str(tmp_path)]) == 2
    assert "GeoTIFF needs rasterio" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_no_run_is_named(tmp_path, capsys):
    assert main([str(tmp_path / "nothing")]) == 2
    assert "nothing" in capsys.readouterr().err


def test_a_full_disk_is_named_with_the_folder(on_earth, tmp_path, monkeypatch, capsys):
    """Linux names no file when a write fails."""
    folder, *_ = on_earth
    monkeypatch.setattr(ascii_grid, "write", Mock(side_effect=OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))))
    assert main([str(folder.parent), "--out", str(tmp_path / "full")]) == 2
    assert capsys.readouterr().err == f"error: {tmp_path / 'full'}: No space left on device\n"
    assert not (tmp_path / "full").exists()


@pytest.mark.parametrize("module", [geotiff, cloud_geotiff, bag, s102])
def test_a_full_disk_is_an_error_of_the_system_also_where_a_library_writes(on_earth, tmp_path, module):
    """GDAL and HDF5 raise errors of their own, or none, and print pages. A limit stands for the disk."""
    _, run, team = on_earth
    team = dataclasses.replace(team, run=dataclasses.replace(run, origin=ORIGIN))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    for most in (0, 100, 1000):
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, limits[1]))
        try:
            with pytest.raises(OSError, match="File too large") as caught:
                module.write(Export(team=team, folder=tmp_path))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert caught.value.errno == errno.EFBIG


def test_a_picture_of_an_earlier_map_is_removed(on_earth, tmp_path):
    folder, *_ = on_earth
    for words in (["--picture"], []):
        assert main([str(folder.parent), "--out", str(tmp_path / "out"), *words]) == 0
        assert (tmp_path / "out" / "export.png").exists() == bool(words)


def test_an_interrupted_export_leaves_the_earlier_one_as_it_was(on_earth, monkeypatch, capsys):
    folder, *_ = on_earth
    before = {path: path.read_bytes() for path in folder.iterdir()}
    monkeypatch.setattr(soundings_csv, "write", Mock(side_effect=KeyboardInterrupt))
    assert main([str(folder.parent), "--datum", "LN02"]) == 130
    assert capsys.readouterr().err == "stopped; the folder has all files of this export, or is as it was\n"
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize("command", ["export", "adjust", "certify"])
def test_a_file_in_place_of_the_output_folder_is_refused_before_anything_is_read(tmp_path, capsys, command):
    (tmp_path / "taken").touch()
    assert verb_main(command)([str(tmp_path), "--out", str(tmp_path / "taken")]) == 2
    out, err = capsys.readouterr()
    assert (out, err) == ("", f"error: {tmp_path / 'taken'}: is not a folder; choose another name\n")


def test_a_pager_that_is_left_early_ends_no_export(on_earth, tmp_path):
    folder, *_ = on_earth
    command = [sys.executable, "-m", "auv_lse_run", "export", str(folder.parent), "--out", str(tmp_path / "out")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline().startswith("reading ")
        process.stdout.close()
        errors = process.stderr.read()
    assert (process.returncode, errors) == (0, "")
    assert {path.name for path in folder.iterdir()} == {path.name for path in (tmp_path / "out").iterdir()}


def test_ctrl_c_leaves_no_traceback(tmp_path, monkeypatch, capsys):
    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("auv_lse_shore.export.command.export", stopped)
    assert main([str(tmp_path)]) == 130
    assert "stopped" in capsys.readouterr().err
