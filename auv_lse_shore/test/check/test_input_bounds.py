"""Inputs of absurd size: each is refused in words, at once, before it takes minutes or all memory."""

from __future__ import annotations

import itertools
import math
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from verb_main import verb_main

from auv_lse_common.mission_file.parameter_file import read_parameter_file, read_yaml
from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.support.input_bounds import MAX_CORNERS, MAX_SOUNDINGS, MAX_TEXT_BYTES, MAX_YAML_BYTES
from auv_lse_gp.soundings import read_soundings
from auv_lse_gp.tables.table_error import TableError
from auv_lse_record.recording import Recording, RecordingError
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.ground_files import load_ground

check = verb_main("check")

MISSION = "/**:\n  ros__parameters:\n"


@pytest.fixture(autouse=True)
def at_once() -> Iterator[None]:
    began = time.process_time()
    yield
    assert time.process_time() - began < 20.0


def sparse(path: Path, size: int) -> Path:
    with path.open("wb") as file:
        file.truncate(size)
    return path


def bomb(levels: int, indent: str = "") -> str:
    lines = [f"{indent}a0: &a0 [{', '.join('0' * 9)}]"]
    lines += [f"{indent}a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, levels)]
    return "\n".join(lines) + "\n"


def test_aliases_that_multiply_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "m.yaml"
    file.write_text(MISSION + bomb(12, "    "))
    with pytest.raises(
        ParameterError, match=r"m\.yaml: not valid YAML: .* too many values: .*, aliases included; at most"
    ):
        read_parameter_file(file)
    file.write_text("a: &a [1, 2]\nb: *a\n")
    assert read_yaml(file) == {"a": [1, 2], "b": [1, 2]}


def test_the_index_of_a_recording_may_not_be_a_bomb_either(tmp_path: Path) -> None:
    (tmp_path / "bag.mcap").touch()
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information:\n" + bomb(12, "  "))
    with pytest.raises(RecordingError, match=r"metadata\.yaml|cannot be read"), Recording(tmp_path):
        pass


def test_a_mission_file_of_a_gigabyte_is_not_read(tmp_path: Path) -> None:
    with pytest.raises(
        ParameterError, match=r"m\.yaml is too large: 1,000 MB, at most 2 MB are read\. Is this a mission file\?$"
    ):
        read_parameter_file(sparse(tmp_path / "m.yaml", 10**9))
    assert MAX_YAML_BYTES < 10**9


def test_a_device_which_may_never_end_is_no_mission_file() -> None:
    with pytest.raises(ParameterError, match=r"^/dev/null: cannot be read: it is a device; name a file$"):
        read_parameter_file(Path("/dev/null"))


def test_20_000_node_patterns_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "m.yaml"
    file.write_text("".join(f"/auv{i}/**: {{ros__parameters: {{a: 1}}}}\n" for i in range(20_000)))
    with pytest.raises(ParameterError, match=r"m\.yaml has 20,000 node patterns, more than 2,000"):
        read_parameter_file(file)


def test_a_polygon_of_20_000_corners_is_refused() -> None:
    def flat(number: int) -> tuple[float, ...]:
        angles = [2.0 * math.pi * i / number for i in range(number)]
        return tuple(itertools.chain.from_iterable((300.0 + 200.0 * math.cos(a), 200.0 * math.sin(a)) for a in angles))

    with pytest.raises(ParameterError, match=r"have 20,000 corners together, more than 2,000\. Simplify"):
        AreaConfig(polygon_m=flat(20_000))
    with pytest.raises(ParameterError, match=r"have 2,004 corners together"):
        AreaConfig(no_go={"a": flat(MAX_CORNERS // 2), "b": flat(MAX_CORNERS // 2)})


@pytest.mark.parametrize("name", ["gp.map_resolution_m", "planner.map_spacing_m"])
def test_check_refuses_a_map_of_too_many_cells(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    section, key = name.split(".")
    file = tmp_path / "m.yaml"
    file.write_text(MISSION + f"    {section}: {{{key}: 1.0e-6}}\n")
    assert check([str(file)]) == 1
    said = capsys.readouterr().out
    assert f"{name}: cells of 1e-06 m divide the area of 600 m x 700 m into 4.2e+17, more than 1,000,000" in said


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_field_of_200_kB_is_refused(tmp_path: Path, separator: str) -> None:
    file = tmp_path / "s.csv"
    file.write_text(f"east_m{separator}north_m{separator}depth_m\n1{separator}2{separator}{'3' * 200_000}\n")
    with pytest.raises(
        TableError, match=r"s\.csv:2: '1.{1,2}2.{1,2}333.* cannot be read as a row: it has more than 20,000 characters"
    ):
        read_soundings(file)
    file.write_text(f"east_m{separator}{'x' * 200_000}\n1{separator}2\n")
    with pytest.raises(TableError, match=r"s\.csv:1: 'east_m"):
        read_soundings(file)


def test_too_many_soundings_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "s.csv"
    file.write_text("east_m,north_m,depth_m\n" + "1,2,3\n" * (MAX_SOUNDINGS + 1))
    with pytest.raises(GroundError, match=r"s\.csv has 500,002 lines, more than 500,000\. Thin it out"):
        load_ground(file)
    with pytest.raises(GroundError, match=r"s\.txt is too large: 1,000 MB, at most 500 MB are read"):
        load_ground(sparse(tmp_path / "s.txt", 2 * MAX_TEXT_BYTES))


def test_an_npz_of_2_gigabytes_is_refused_by_its_headers(tmp_path: Path) -> None:
    """2 GB of zeros are 2 MB compressed; only the header is needed here."""
    file = tmp_path / "g.npz"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, shape in (("north_m", (16_000,)), ("east_m", (16_000,)), ("depth_m", (16_000, 16_000))):
            with archive.open(f"{name}.npy", "w") as member:
                header = {"descr": "<f8", "fortran_order": False, "shape": shape}
                np.lib.format.write_array_header_1_0(member, header)
    with pytest.raises(GroundError, match=r"g\.npz: depth_m has the shape \(16000, 16000\), more than 25,000,000"):
        load_ground(file)


def test_a_text_grid_is_refused_by_its_header_and_by_its_size(tmp_path: Path) -> None:
    file = tmp_path / "g.asc"
    file.write_text("ncols 60000\nnrows 60000\nxllcorner 0\nyllcorner 0\ncellsize 1\n")
    with pytest.raises(GroundError, match=r"g\.asc has 60,000 x 60,000 nodes, more than 25,000,000"):
        load_ground(file)
    with pytest.raises(GroundError, match=r"g\.asc is too large: 1,000 MB, at most 500 MB are read"):
        load_ground(sparse(file, 2 * MAX_TEXT_BYTES))


def test_a_sparse_raster_is_refused_by_its_header(tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio")
    file = tmp_path / "g.tif"
    shape = {"width": 60_000, "height": 60_000, "count": 1, "dtype": "float64"}
    transform = rasterio.Affine(2.0, 0.0, 0.0, 0.0, -2.0, 0.0)
    with rasterio.open(file, "w", "GTiff", **shape, transform=transform, sparse_ok=True, bigtiff="yes"):
        pass
    with pytest.raises(GroundError, match=r"g\.tif has 60,000 x 60,000 nodes, more than 25,000,000"):
        load_ground(file)


def test_what_is_called_tif_and_is_none_is_not_opened(tmp_path: Path) -> None:
    """A VRT is text that names other files, and addresses."""
    rasterio = pytest.importorskip("rasterio")
    secret = tmp_path / "secret.tif"
    transform = rasterio.Affine(10.0, 0.0, 0.0, 0.0, -10.0, 100.0)
    with rasterio.open(
        secret, "w", "GTiff", width=10, height=10, count=1, dtype="float32", transform=transform
    ) as data:
        data.write(np.linspace(0.1, 12.0, 100, dtype=np.float32).reshape(10, 10), 1)
    load_ground(secret)
    vrt = tmp_path / "g.tif"
    vrt.write_text(
        '<VRTDataset rasterXSize="10" rasterYSize="10"><GeoTransform>0, 10, 0, 100, 0, -10</GeoTransform>'
        '<VRTRasterBand dataType="Float32" band="1"><SimpleSource>'
        f'<SourceFilename relativeToVRT="0">{secret}</SourceFilename><SourceBand>1</SourceBand>'
        "</SimpleSource></VRTRasterBand></VRTDataset>"
    )
    with pytest.raises(GroundError, match=r"g\.tif is not a readable raster"):
        load_ground(vrt)
