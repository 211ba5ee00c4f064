"""The worked example of docs/extending/adding-a-log-format.md: one file, added to a copy of the package."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from adjust.survey_logs import survey

import auv_lse_shore
from auv_lse_shore.survey_import import formats

PAGE = Path(__file__).resolve().parents[3] / "docs" / "extending" / "adding-a-log-format.md"


def test_a_format_is_one_file(tmp_path):
    copy = tmp_path / "packages" / "auv_lse_shore"
    shutil.copytree(Path(auv_lse_shore.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (copy / "survey_import" / "formats" / "lines.py").write_text(code)
    lines = [f"T{t:.1f} P{lat:.8f},{lon:.8f} D{depth:.2f}" for t, lat, lon, depth in survey()[:100]]
    (tmp_path / "a.txt").write_text("\n".join([*lines, "T17"]) + "\n")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(copy.parent), *sys.path])}
    command = [sys.executable, "-m", "auv_lse_run", "import"]

    def said(*arguments):
        done = subprocess.run([*command, *arguments], capture_output=True, text=True, cwd=tmp_path, env=environment)
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert "Lines of a home-made logger: T, P and D" in said("--help")
    shown = said("a.txt", "--dry-run")
    assert "a.txt: 100 soundings of 100 depths; positions from lines; depths from depth" in shown
    assert "- left out: 1 line that is incomplete" in shown


def test_a_reader_is_one_short_file():
    for module in formats.formats():
        assert len(Path(module.__file__).read_text().splitlines()) <= 120, module.__name__
        assert callable(module.recognizes)
        assert callable(module.read)
