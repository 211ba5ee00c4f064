"""The worked example of docs/extending/adding-an-export-format.md: one file, added to a copy of the package."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

import auv_lse_shore
from auv_lse_common.vocabulary.frames import local_from_geodetic
from auv_lse_record.run_writer import write_run

PAGE = Path(__file__).resolve().parents[3] / "docs" / "extending" / "adding-an-export-format.md"
ORIGIN = (46.5, 6.6)


def test_a_format_is_one_file(tmp_path, synthetic_run):
    run = synthetic_run(steps=12)
    run.parameters["/**"]["area"] |= {"origin_lat_deg": ORIGIN[0], "origin_lon_deg": ORIGIN[1]}
    write_run(run, tmp_path / "run")
    copy = tmp_path / "packages" / "auv_lse_shore"
    shutil.copytree(Path(auv_lse_shore.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (copy / "export" / "formats" / "gpx.py").write_text(code)

    path = os.pathsep.join([str(copy.parent), *sys.path])
    command = [sys.executable, "-m", "auv_lse_run", "export"]

    def said(*arguments):
        environment = {**os.environ, "PYTHONPATH": path}
        done = subprocess.run([*command, *arguments], capture_output=True, text=True, cwd=tmp_path, env=environment)
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert "isobath.gpx: the isobath that was found, for chart plotters and handheld GPS receivers." in said("--help")
    assert re.search(r"^ +isobath.gpx \(\d+ pieces\)$", said("run"), re.MULTILINE)
    points = ElementTree.parse(tmp_path / "run" / "export" / "isobath.gpx").findall(".//{*}trkpt")
    north, east = local_from_geodetic(*np.array([[float(p.get(k)) for p in points] for k in ("lat", "lon")]), *ORIGIN)
    valley = 120.0 + 30.0 * np.sin(east / 50.0)  # the synthetic run's true isobath
    assert np.abs(north - valley).mean() < 3.0
