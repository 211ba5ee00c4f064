"""Figures of a mission that are maps: north up, in colors for the color-blind, and helpers of all figures.

Vehicles have the colors of Okabe and Ito (2008) and, from the ninth on, other dashes; risk has a perceptually uniform
color map. Cells that are not evaluated are left out. Maps are to scale, unless the area is far longer than wide.
"""

import contextlib
import functools
import math
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeVar

import matplotlib
import numpy as np
from matplotlib import font_manager
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke

from auv_lse_common.support.arrays import Array
from auv_lse_gp.map.certainty import CLASSES, FOUND, GUESSED, LIKELY, Piece, lines_of
from auv_lse_shore.judge.evaluation import Evaluation
from auv_lse_shore.judge.quantity_names import COST_PER_LOCATION, DEPTH, DEPTH_STD, MAP_RISK
from auv_lse_shore.judge.tracks import navigation_error, track
from auv_lse_shore.report.map_marks import add_graticule

P = ParamSpec("P")
T = TypeVar("T")

#: Colors for categories (Okabe and Ito 2008), distinguishable with every common color blindness.
COLORS = ("#D55E00", "#56B4E9", "#009E73", "#CC79A7", "#E69F00", "#0072B2", "#F0E442", "#000000")
DASHES = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)))
RISK_COLORS = "cividis"
DIFFERENCE_COLORS = "PuOr_r"
#: Fonts with Chinese, Japanese and Korean letters, which labels may have.
_CJK = re.compile("CJK|Han Sans|Han Serif|WenQuanYi|Droid Sans Fallback|Gothic|Nanum|YaHei|SimHei|PingFang|Unifont")


def cjk_fonts(installed: Iterable[str]) -> list[str]:
    """Those of the installed fonts that may have Chinese, Japanese and Korean letters; each is looked up in turn."""
    return sorted({name for name in installed if _CJK.search(name)})


STYLE = {
    "font.family": ["DejaVu Sans", *cjk_fonts(font_manager.get_font_names())],
    "font.size": 8.5,
    "axes.titlesize": 9.5,
    "axes.labelsize": 8.5,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "axes.linewidth": 0.7,
    "axes.grid": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "figure.facecolor": "white",
    "axes.titlelocation": "left",
}
WIDTH_IN = 7.3
DPI = 200
LEGEND_COLUMNS = 7
#: Height (in) of a line of a legend.
_LINE_IN = 0.17
#: Largest ratio of a map's sides; a longer area is stretched across.
MAX_ASPECT = 4.0


def vehicle_style(index: int) -> dict[str, Any]:
    """Color and dashes of vehicle number `index` + 1."""
    return {"color": COLORS[index % len(COLORS)], "linestyle": DASHES[index // len(COLORS) % len(DASHES)]}


def save(figure: Figure, path: Path) -> None:
    """Writes a figure as PNG.

    It is laid out once, where `savefig` by itself would do so twice; twice below labels of longitude, which titles
    make room for only once these are placed.
    """
    FigureCanvasAgg(figure)
    figure.set_dpi(DPI)
    with _boxes_for_missing_letters():
        if (layout := figure.get_layout_engine()) is not None:
            for _ in range(2 if any(axis.child_axes for axis in figure.axes) else 1):
                layout.execute(figure)
        figure.set_layout_engine("none")
        figure.savefig(path, dpi=DPI, metadata={"Software": None}, pil_kwargs={"compress_level": 3})


@contextlib.contextmanager
def _boxes_for_missing_letters() -> Iterator[None]:
    """A context in which letters that no installed font has become boxes without a warning."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph .* missing from")
        yield


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure; maps keep together in its middle."""
    return Figure(figsize=(width_in, height_in), layout="compressed")


def styled(draw: Callable[P, T]) -> Callable[P, T]:
    """Decorates a function that draws: it uses `STYLE`."""

    @functools.wraps(draw)
    def in_style(*args: P.args, **kwargs: P.kwargs) -> T:
        with matplotlib.rc_context(STYLE), _boxes_for_missing_letters():
            return draw(*args, **kwargs)

    return in_style


def add_grid(axis: Any, direction: Literal["both", "x"] = "both") -> None:
    """Draws a pale grid behind the data."""
    axis.grid(True, axis=direction, color="#e4e4e4", lw=0.5)
    axis.set_axisbelow(True)


def draw_map(axis: Any, e: Evaluation, values: Array, title: str, **scale: Any) -> Any:
    """Draws values (R, C) of a mission's map, what is not evaluated left out; returns the image.

    Args:
        values: One for each cell of the map.
        scale: Color map and limits, as of `imshow`.
    """
    extent, _ = map_extent(e)
    _, north_to_east = map_shape(extent)
    shown = np.ma.masked_where(~e.scored, values)
    image = axis.imshow(shown, origin="lower", extent=extent, aspect=north_to_east, **scale)
    axis.set_title(title)
    axis.set_facecolor("#ececec")
    axis.set_xlim(extent[0], extent[1])
    axis.set_ylim(extent[2], extent[3])
    for spine in axis.spines.values():
        spine.set_visible(True)
    return image


def add_color_bar(figure: Figure, image: Any, axes: Any, label: str, **layout: Any) -> Any:
    """Adds a color bar beside the axes (below, with `orientation`); returns it."""
    bar = figure.colorbar(image, ax=axes, **{"shrink": 0.9, "pad": 0.015, "aspect": 28, **layout})
    bar.set_label(label)
    bar.outline.set_linewidth(0.5)
    return bar


@styled
def risk_maps(e: Evaluation) -> Figure:
    """Prior and posterior Bayes risk with the paths, and the true and the estimated isobath."""
    panel_in, side_by_side = panel_size(map_extent(e)[1], 2)
    columns = 2 if side_by_side else 1
    handles = map_handles(e, truth=bool(e.truth), estimate=True)
    figure = new_figure(WIDTH_IN, panel_in * (1 if side_by_side else 2) + 0.75 + legend_in(handles))
    axes = figure.subplots(2 // columns, columns, sharex=True, sharey=True, squeeze=False).ravel()
    top = max(float(np.nanmax(e.prior.risk)), 1e-9)
    titles = (
        rf"$\bf{{a}}$  {MAP_RISK.capitalize()} before the mission",
        rf"$\bf{{b}}$  {MAP_RISK.capitalize()} given all soundings",
    )
    image: Any = None
    for axis, title, field in zip(axes, titles, (e.prior, e.team), strict=True):
        image = draw_map(axis, e, field.risk, title, cmap=RISK_COLORS, vmin=0.0, vmax=top)
        draw_tracks(axis, e)
        draw_isobath(axis, e.truth, "true")
    draw_pieces(axes[1], e.pieces)
    outer_labels(axes, columns, e.run.origin)
    add_color_bar(figure, image, axes.tolist(), f"{MAP_RISK} ({COST_PER_LOCATION})")
    map_legend(figure, handles)
    return figure


@styled
def local_risk_error(e: Evaluation) -> Figure:
    """Per vehicle: posterior risk of its own final map minus the risk given all soundings."""
    aspect, count = map_extent(e)[1], len(e.local)
    columns = min(count, 3 if aspect >= 0.5 else 2)
    rows = math.ceil(count / columns)
    width = WIDTH_IN if columns > 1 else 0.65 * WIDTH_IN
    panel_in = min((width - 1.3) / columns * aspect, 5.0) + 0.45
    handles = map_handles(e, truth=False, estimate=False)
    figure = new_figure(width, rows * panel_in + 0.7 + legend_in(handles))
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    differences = [own.risk - e.team.risk for own in e.local]
    largest = max((float(np.nanmax(np.abs(d[e.scored]))) for d in differences), default=0.0) or 1.0
    image: Any = None
    for index, (axis, difference) in enumerate(zip(axes, differences, strict=False)):
        title = f"auv{e.run.vehicles[index].vehicle}\nmean |difference| {e.summary.local_risk_error[index]:.3f}"
        image = draw_map(axis, e, difference, title, cmap=DIFFERENCE_COLORS, vmin=-largest, vmax=largest)
        draw_tracks(axis, e, only=index)
    for axis in axes[count:]:
        axis.set_visible(False)
    outer_labels(axes[:count], columns, e.run.origin)
    label = f"own map's − team map's\n{MAP_RISK} ({COST_PER_LOCATION})"
    add_color_bar(figure, image, axes[:count].tolist(), label, aspect=26 * rows)
    map_legend(figure, handles)
    return figure


@styled
def depth_map(e: Evaluation) -> Figure:
    """The estimated depth, its standard deviation, and its error where the truth is known."""
    std_scale: dict[str, Any] = {"cmap": RISK_COLORS, "vmin": 0.0}
    panels: list[tuple[str, str, Array, dict[str, Any]]] = [
        (r"$\bf{a}$  Estimated depth", f"{DEPTH} (m)", e.team.mean_m, {"cmap": "viridis_r"}),
        (r"$\bf{b}$  Its standard deviation", f"{DEPTH_STD} (m)", e.team.std_m, std_scale),
    ]
    if e.run.ground is not None:
        error = e.team.mean_m - e.run.ground.depth_m
        limit = float(np.nanpercentile(np.abs(error[e.scored]), 99.0)) or 1.0
        scale = {"cmap": DIFFERENCE_COLORS, "vmin": -limit, "vmax": limit}
        panels.append((r"$\bf{c}$  Error", "estimate − truth (m)", error, scale))
    aspect = map_extent(e)[1]
    columns = len(panels) if aspect >= 0.5 else 1
    if columns == 1:
        panels_in, bars = len(panels) * ((WIDTH_IN - 1.6) * aspect + 0.3), {}
    else:
        panels_in = min((WIDTH_IN - 2.2) / columns * aspect, 7.5) + 1.15
        bars = {"orientation": "horizontal", "shrink": 0.95, "pad": 0.02, "aspect": 24}
    figure = new_figure(WIDTH_IN, panels_in + 0.8)
    axes = figure.subplots(len(panels) // columns, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for axis, (title, label, values, scale) in zip(axes, panels, strict=True):
        image = draw_map(axis, e, values, title, **scale)
        draw_isobath(axis, e.truth, "true")
        draw_pieces(axis, e.pieces)
        add_color_bar(figure, image, axis, label, **bars)
    outer_labels(axes, columns, e.run.origin)
    lines = isobath_handles(e) + ([isobath_handle("true", "true isobath")] if e.truth else [])
    figure.legend(handles=lines, loc="outside lower center", ncols=4, handlelength=2.6)
    return figure


@styled
def navigation(e: Evaluation) -> Figure | None:
    """Horizontal error of each vehicle's odometry over time; None without truth."""
    errors = [navigation_error(v) for v in e.run.vehicles]
    if not all(len(error) for error in errors):
        return None
    rows = math.ceil(len(errors) / LEGEND_COLUMNS)
    figure = new_figure(WIDTH_IN, 2.4 + 0.2 * rows)
    axis = figure.subplots()
    for index, (vehicle, error) in enumerate(zip(e.run.vehicles, errors, strict=True)):
        minutes = vehicle.odometry[:, 0] / 60.0
        axis.plot(minutes, error, lw=1.3, label=f"auv{vehicle.vehicle}", **vehicle_style(index))
    axis.set_xlabel("mission time (min)")
    axis.set_ylabel("horizontal error (m)")
    axis.set_xlim(left=0.0)
    axis.set_ylim(bottom=0.0)
    add_grid(axis)
    figure.legend(loc="outside lower center", ncols=min(len(errors), LEGEND_COLUMNS), handlelength=2.0)
    return figure


def map_extent(e: Evaluation) -> tuple[tuple[float, float, float, float], float]:
    """Extent (left, right, bottom, top) in m of the map's image, and its height / width as drawn."""
    grid = e.team.grid
    half = 0.5 * grid.resolution_m
    extent = (
        float(grid.east_m[0] - half),
        float(grid.east_m[-1] + half),
        float(grid.north_m[0] - half),
        float(grid.north_m[-1] + half),
    )
    return extent, map_shape(extent)[0]


def map_shape(extent: tuple[float, float, float, float]) -> tuple[float, float]:
    """Height / width of a map as drawn, and the drawn length of a metre north relative to one east.

    Args:
        extent: Left, right, bottom, top (m).
    """
    aspect = (extent[3] - extent[2]) / (extent[1] - extent[0])
    drawn = min(max(aspect, 1.0 / MAX_ASPECT), MAX_ASPECT)
    return drawn, drawn / aspect


def panel_size(aspect: float, columns: int) -> tuple[float, bool]:
    """Height (in) of one map panel, and whether `columns` of them fit side by side."""
    side_by_side = aspect >= 0.5
    width = (WIDTH_IN - 1.4) / (columns if side_by_side else 1)
    return min(width * aspect, 7.5) + 0.25, side_by_side


def outer_labels(axes: Any, columns: int, origin: tuple[float, float] | None = None) -> None:
    """Labels the outer axes of panels in `columns` columns.

    North is on the left, east at the bottom; with an origin (deg), latitude is on the right, longitude at the top.
    """
    for index, axis in enumerate(axes):
        last = index % columns == columns - 1 or index == len(axes) - 1
        add_graticule(axis, origin, latitudes=last, longitudes=index < columns)
        if index % columns == 0:
            axis.set_ylabel(axis_label("north", float(axis.get_aspect())))
        if index >= len(axes) - columns:
            axis.set_xlabel(axis_label("east", 1.0 / float(axis.get_aspect())))
            axis.tick_params(labelbottom=True)


def axis_label(name: str, stretch: float) -> str:
    """Label of an axis in metres; `stretch`: the drawn length of its metre relative to one of the other axis."""
    return f"{name} (m),\nstretched {stretch:.2g} times" if stretch >= 1.05 else f"{name} (m)"


def draw_tracks(axis: Any, e: Evaluation, only: int | None = None, width: float = 1.25) -> None:
    """Draws the vehicles' tracks with start and end, `width` points wide; `only`: of the vehicle of that index."""
    thin = min(width, 1.25 if len(e.run.vehicles) <= 6 else 0.8)
    for index, vehicle in enumerate(e.run.vehicles):
        if only is not None and index != only:
            continue
        rows = track(vehicle)
        if len(rows) == 0:
            continue
        style = vehicle_style(index)
        casing = [Stroke(linewidth=thin + 1.1, foreground="white", alpha=0.9), Normal()]
        axis.plot(rows[:, 2], rows[:, 1], lw=thin, path_effects=casing, solid_capstyle="round", **style)
        axis.plot(*rows[0, [2, 1]], "o", ms=4.5, mfc="white", mec="black", mew=0.9, zorder=5)
        axis.plot(*rows[-1, [2, 1]], "s", ms=4.5, mfc=style["color"], mec="black", mew=0.7, zorder=5)


#: Lines of the true isobath and of the classes of the estimated one; `casing` is the color on both sides of the line.
_ISOBATHS: dict[str, dict[str, Any]] = {
    "true": {"color": "white", "linestyle": (0, (3.5, 1.6)), "linewidth": 1.0, "casing": "black"},
    FOUND: {"color": "black", "linestyle": "-", "linewidth": 1.6, "casing": "white"},
    LIKELY: {"color": "#F0E442", "linestyle": "-", "linewidth": 1.5, "casing": "black"},
    GUESSED: {"color": "#555555", "linestyle": (0, (1.0, 1.8)), "linewidth": 1.1, "casing": "white"},
}


def draw_isobath(axis: Any, lines: Sequence[Array], kind: str) -> None:
    """Draws lines (n, 2) of north, east (m); `kind` is "true" or a class of `certainty.CLASSES`."""
    for line in lines:
        axis.plot(line[:, 1], line[:, 0], zorder=4.5 if kind == "true" else 4.0, **_isobath_style(kind, 0.9))


def draw_pieces(axis: Any, pieces: Sequence[Piece]) -> None:
    """Draws the estimated isobath, each piece in the style of its class, the surest on top."""
    for kind in reversed(CLASSES):
        draw_isobath(axis, lines_of(pieces, kind), kind)


def _isobath_style(kind: str, casing: float) -> dict[str, Any]:
    style = dict(_ISOBATHS[kind])
    beside = Stroke(linewidth=style["linewidth"] + casing, foreground=style.pop("casing"), alpha=0.85)
    return {**style, "path_effects": [beside, Normal()]}


def isobath_handles(e: Evaluation) -> list[Line2D]:
    """Legend entries of the estimated isobath's classes, those that occur."""
    level = e.settings[0].level_set.level_m
    kinds = [kind for kind in CLASSES if lines_of(e.pieces, kind)]
    words = {FOUND: f"{level:g} m isobath, found", LIKELY: "likely", GUESSED: "guessed"}
    return [isobath_handle(kind, words[kind]) for kind in kinds]


def isobath_handle(kind: str, label: str) -> Line2D:
    """Legend entry of an isobath; `kind` as of `draw_isobath`."""
    return Line2D([], [], label=label, **_isobath_style(kind, 1.2))


def legend_below(figure: Figure, handles: Sequence[Any], columns: int, **style: Any) -> None:
    """Adds a legend below a figure, which grows by each line after the first.

    Args:
        columns: Largest number of columns; wide labels have fewer, and at last smaller letters, so that the figure cuts
            none off.
    """
    for count in range(min(columns, len(handles)), 0, -1):
        legend = figure.legend(handles=list(handles), loc="outside lower center", ncols=count, **style)
        part = figure.bbox.width / legend.get_window_extent().width
        if part >= 1.0:
            break
        if count == 1:
            for text in legend.get_texts():  # a little smaller still: the frame and the lines do not shrink
                text.set_fontsize(0.97 * part * float(text.get_fontsize()))
            break
        legend.remove()
    figure.set_figheight(figure.get_figheight() + _LINE_IN * (math.ceil(len(handles) / count) - 1))


def legend_in(handles: Sequence[Any]) -> float:
    """Height (in) of a `map_legend` after its first line."""
    return _LINE_IN * ((len(handles) - 1) // LEGEND_COLUMNS)


def map_handles(e: Evaluation, *, truth: bool, estimate: bool) -> list[Any]:
    """Legend entries of the vehicles and, where wanted, of the isobaths."""
    level = e.settings[0].level_set.level_m
    handles: list[Any] = [
        Line2D([], [], lw=1.6, label=f"auv{v.vehicle}", **vehicle_style(i)) for i, v in enumerate(e.run.vehicles)
    ]
    handles.append(Line2D([], [], ls="", marker="o", mfc="white", mec="black", label="start"))
    handles.append(Line2D([], [], ls="", marker="s", mfc="#999999", mec="black", label="end"))
    if truth:
        handles.append(isobath_handle("true", f"true {level:g} m isobath"))
    if estimate:
        handles += isobath_handles(e)
    if not e.scored.all():
        handles.append(Patch(facecolor="#ececec", edgecolor="#888888", linewidth=0.5, label="not evaluated"))
    return handles


def map_legend(figure: Figure, handles: Sequence[Any]) -> None:
    """Adds a legend with these entries below a figure, in lines of equal length."""
    figure.legend(
        handles=list(handles),
        loc="outside lower center",
        ncols=math.ceil(len(handles) / math.ceil(len(handles) / LEGEND_COLUMNS)),
        handlelength=2.2,
        columnspacing=1.4,
    )
