"""The page of a campaign."""

import pytest
from sim_helpers import spec_of

from auv_lse_shore.campaign.comparison_figures import MAP_CURVES, PAPER_CURVES, curves, sweep_figure
from auv_lse_shore.campaign.page import _best, _figures, _mean, write_page

SEEDS = range(1, 9)


def rows(offset, noise):
    return [{"seed": s, "isobath_error_m": 10.0 + s + offset + noise * (-1) ** s} for s in SEEDS]


@pytest.mark.parametrize(
    ("noise", "words"),
    [
        (0.1, "best mean isobath error, whole line (m): a"),
        (3.0, "best mean isobath error, whole line (m): a (not significantly better than b)"),
    ],
)
def test_a_best_setting_within_the_noise_is_reported_as_such(noise, words):
    ((_, meaning),) = _best({"a": rows(0.0, 0.0), "b": rows(0.5, noise), "c": rows(9.0, noise)})
    assert meaning == words


def test_the_best_setting_is_chosen_over_the_seeds_of_which_all_have_a_value():
    lucky = [{**row, "isobath_error_m": row["isobath_error_m"] if row["seed"] < 3 else None} for row in rows(0.5, 0.0)]
    ((value, meaning),) = _best({"steady": rows(0.0, 0.0), "lucky": lucky, "never": [{"seed": 1}]})
    words = "best mean isobath error, whole line (m), over the 2 of 8 seeds with a value for all other settings"
    assert meaning.startswith(f"{words} (1 setting has no value): steady")
    assert float(value) == pytest.approx(11.5)


def test_settings_without_a_common_seed_are_not_compared():
    assert not list(_best({"a": rows(0.0, 0.0)[:4], "b": rows(0.0, 0.0)[4:]}))


def test_many_settings_within_the_noise_are_counted():
    ((_, meaning),) = _best({str(number): rows(0.0, 0.1 * number) for number in range(8)})
    assert meaning.endswith("(not significantly better than 7 others)")


@pytest.mark.parametrize("draw", ["curves", "sweep"])
def test_a_legend_of_long_names_fits_its_figure(draw):
    names = [f"a label of thirty characters, method lawnmower {number}" for number in range(10)]
    if draw == "curves":
        figure = curves({name: [{"seed": s, "risk": [3.0, 2.0]} for s in SEEDS] for name in names}, MAP_CURVES)
    else:
        figure = sweep_figure({name: [(0.0, rows(0.0, 0.1)), (1.0, rows(0.0, 0.1))] for name in names}, "loss")
    figure.canvas.draw()
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert 0.0 <= box.x0 < box.x1 <= figure.bbox.width
    assert 0.0 <= box.y0 < box.y1 <= figure.bbox.height
    assert all(axis.get_window_extent().height > 100.0 for axis in figure.axes)
    styles = {(line.get_color(), line.get_linestyle()) for line in legend.get_lines()}
    assert len(styles) == len(names), "lines of the same color differ in their dashes"


def test_a_figure_that_leaves_settings_out_says_how_many(tmp_path):
    spec = spec_of(tmp_path, grid={"planner.horizon": list(range(1, 18))})
    groups = {label: [{"seed": 1, "risk": [3.0, 2.0], "status": "ok"}] for label, _ in spec.settings}
    captions = {name: caption for name, _, caption in _figures(spec, groups)}
    assert captions["risk_curves.png"].endswith(" Only the first 16 of the 17 settings are shown.")


def test_a_mean_over_fewer_seeds_shows_their_number():
    some = [{"seed": 1, "f1": 0.5}, {"seed": 2, "f1": None}]
    assert _mean(some, "f1") == "0.5 (1 of 2 seeds)"
    assert _mean(some[:1], "f1") == "0.5"
    assert _mean(some[1:], "f1") == "–"


@pytest.mark.parametrize("columns", [MAP_CURVES, PAPER_CURVES])
def test_the_labels_of_curves_fit_their_figure(columns):
    steps = {column: [4.0, 3.0, 2.0] for column, _ in columns}
    figure = curves({name: [{"seed": s, **steps} for s in SEEDS] for name in ("a", "b")}, columns)
    figure.canvas.draw()
    for axis in figure.axes:
        label = axis.yaxis.label.get_window_extent()
        assert 0.0 <= label.y0 < label.y1 <= figure.bbox.height


@pytest.mark.parametrize(
    ("grid", "same"), [({"planner.method": ["plain", "tour"]}, True), ({"sim.lake.deepest_m": [30.0, 35.0]}, False)]
)
def test_settings_share_their_lakes_only_if_they_do_not_vary_them(tmp_path, grid, same):
    text = write_page(spec_of(tmp_path, grid=grid), [], tmp_path).read_text()
    assert ("All settings share the same lakes." in text) == same
    assert "2 settings, 1 seed, 2 missions; 0 finished" in text
