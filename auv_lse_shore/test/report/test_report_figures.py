"""Maps keep their shape readable, and an error while drawing on two cores waits for the other half."""

from __future__ import annotations

import dataclasses
import itertools
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from auv_lse_common.vocabulary.frames import local_from_geodetic
from auv_lse_shore.judge.evaluation import evaluate
from auv_lse_shore.report import report_figures
from auv_lse_shore.report.figures import WIDTH_IN, depth_map, local_risk_error, new_figure, risk_maps
from auv_lse_shore.report.found_figure import found
from auv_lse_shore.report.map_marks import add_graticule


def test_a_home_that_cannot_be_written_is_no_news() -> None:
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("XDG_", "MPL"))}
    code = [sys.executable, "-c", "import auv_lse_shore.report.figures"]
    done = subprocess.run(code, env={**environment, "HOME": "/dev/null"}, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stderr) == (0, "")


def test_an_error_leaves_no_process_that_still_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(e: Any) -> Figure:
        raise ValueError("the first error")

    def takes_long(e: Any) -> Figure | None:
        time.sleep(0.5)
        (tmp_path / "late").touch()
        raise OSError("the second error")

    monkeypatch.setattr(report_figures, "FIGURES", (("a.png", "", fails), ("b.png", "", takes_long)))
    with pytest.raises(ValueError, match="the first error"):
        report_figures.draw_all(None, tmp_path)  # type: ignore[arg-type]
    assert (tmp_path / "late").exists(), "else a removed folder would be written to"


@pytest.mark.parametrize(
    ("corners", "stretched"),
    [
        ([0.0, 0.0, 3000.0, 0.0, 3000.0, 80.0, 0.0, 80.0], "east (m),\nstretched 9.4 times"),
        ([0.0, 0.0, 80.0, 0.0, 80.0, 3000.0, 0.0, 3000.0], "north (m),\nstretched 9.4 times"),
        ([0.0, 0.0, 240.0, 0.0, 240.0, 300.0, 0.0, 300.0], None),
    ],
    ids=["river north", "river east", "lake"],
)
def test_a_map_of_a_river_is_no_thread(synthetic_run: Any, corners: list[float], stretched: str | None) -> None:
    run = synthetic_run(steps=12)
    run.parameters["/**"]["area"]["polygon_m"] = corners
    run.parameters["/**"]["gp"]["map_resolution_m"] = 10.0
    e = evaluate(dataclasses.replace(run, ground=None))
    for draw in (found, risk_maps, local_risk_error, depth_map):
        figure = draw(e)
        FigureCanvasAgg(figure).draw()
        width_in, height_in = figure.get_size_inches()
        assert 1.9 <= height_in <= 12.0
        maps = [axis for axis in figure.axes if axis.images and axis.get_label() != "<colorbar>"]
        boxes = [axis.get_window_extent() for axis in maps]
        assert min(min(box.width, box.height) for box in boxes) >= 0.08 * width_in * figure.dpi
        labels = {label for axis in maps for label in (axis.get_xlabel(), axis.get_ylabel()) if label}
        assert labels - {"east (m)", "north (m)"} == ({stretched} if stretched else set())
        for axis in maps:
            title = axis.title.get_window_extent() if axis.get_title() else axis.get_window_extent()
            assert title.x1 <= width_in * figure.dpi + 1.0


@pytest.mark.parametrize("panels", [1, 3])
def test_longitudes_above_narrow_maps_do_not_run_into_each_other(panels):
    figure = new_figure(WIDTH_IN, 4.0)
    for axis in np.atleast_1d(figure.subplots(1, panels)):
        axis.set_xlim(-90.0, 650.0)
        axis.set_ylim(-90.0, 650.0)
        add_graticule(axis, (46.5, 6.6))
    FigureCanvasAgg(figure).draw()
    for axis in figure.axes:
        *_, top = axis.child_axes
        boxes = [label.get_window_extent() for label in top.get_xticklabels()]
        assert len(boxes) >= 2
        assert all(a.x1 < b.x0 for a, b in itertools.pairwise(boxes))


def test_longitudes_on_both_sides_of_the_antimeridian_are_labeled_at_their_locations():
    figure = new_figure(WIDTH_IN, 5.0)
    axis = figure.subplots()
    axis.set_xlim(-300.0, 300.0)
    axis.set_ylim(-300.0, 300.0)
    origin = (-16.8, -179.9997)
    add_graticule(axis, origin)
    *_, top = axis.child_axes
    east_of = {label.get_text(): at for at, label in zip(top.get_xticks(), top.get_xticklabels(), strict=True)}
    assert {text[-1] for text in east_of} == {"E", "W"}
    for text, east in east_of.items():
        lon = float(text[:-3]) * (1.0 if text[-1] == "E" else -1.0)
        assert local_from_geodetic(origin[0], lon, *origin)[1] == pytest.approx(east, abs=2.0)
