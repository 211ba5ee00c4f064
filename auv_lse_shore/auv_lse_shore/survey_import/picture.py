"""Draws an imported survey: tracks, depths, and the area in which they are known."""

from pathlib import Path

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from auv_lse_record.run_data import RunData
from auv_lse_shore.report.figures import WIDTH_IN, add_color_bar, new_figure, save, styled
from auv_lse_shore.report.map_marks import add_graticule, add_scale_bar
from auv_lse_shore.survey_import.area import SurveyedArea

#: The most points of a track, and soundings, that are drawn.
_POINTS = 20_000
_BORDER, _VOID = "#2b5d80", "#b03a2e"


@styled
def draw_survey(run: RunData, area: SurveyedArea, path: Path) -> None:
    """Draws tracks, depths and the proposed area as a picture.

    Args:
        area: Its area, with the ground that was not sounded.
    """
    points = np.concatenate([vehicle.soundings.points_m for vehicle in run.vehicles])
    points = points[:: len(points) // _POINTS + 1]
    low, high = area.polygon.min(axis=0), area.polygon.max(axis=0)
    pad = 0.04 * float((high - low).max())
    aspect = float((high - low)[0] + 2.0 * pad) / float((high - low)[1] + 2.0 * pad)
    figure = new_figure(WIDTH_IN, min(max((WIDTH_IN - 1.2) * aspect, 2.0), 8.0) + 1.0)
    axis = figure.subplots()
    axis.set_aspect("equal")
    axis.add_patch(Polygon(area.polygon[:, ::-1], closed=True, facecolor="#dcebf5", edgecolor=_BORDER, lw=1.2))
    for corners in area.no_go.values():
        axis.add_patch(Polygon(corners[:, ::-1], closed=True, facecolor="white", edgecolor=_VOID, hatch="////", lw=0.8))
    for vehicle in run.vehicles:
        track = vehicle.odometry[:: len(vehicle.odometry) // _POINTS + 1]
        axis.plot(track[:, 2], track[:, 1], color="#777777", lw=0.5)
    dots = axis.scatter(points[:, 1], points[:, 0], c=points[:, 2], s=5.0, cmap="viridis_r", linewidths=0.0)
    add_color_bar(figure, dots, axis, "depth (m)")
    axis.set_xlim(low[1] - pad, high[1] + pad)
    axis.set_ylim(low[0] - pad, high[0] + pad)
    add_graticule(axis, run.origin)
    add_scale_bar(axis)
    axis.set_xlabel("east (m)")
    axis.set_ylabel("north (m)")
    handles = [
        Line2D([], [], color="#777777", lw=0.8, label="track"),
        Patch(facecolor="#dcebf5", edgecolor=_BORDER, label="proposed area"),
    ]
    if area.no_go:
        handles.append(Patch(facecolor="white", edgecolor=_VOID, hatch="////", label="not sounded"))
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    save(figure, path)
