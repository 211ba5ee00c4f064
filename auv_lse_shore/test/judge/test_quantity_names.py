"""One name for a quantity, whatever screen it is on."""

from matplotlib.text import Text

from auv_lse_common.mission_file.settings import Settings
from auv_lse_shore.judge import quantity_names as names
from auv_lse_shore.judge.evaluation import evaluate
from auv_lse_shore.judge.summary import Summary
from auv_lse_shore.live.sources.facts import mission_facts
from auv_lse_shore.live.sources.map_layers import scales_of
from auv_lse_shore.report.report_figures import FIGURES
from auv_lse_shore.report.words import headlines, quality_cards


def test_summary_terminal_report_and_live_page_call_a_quantity_the_same(synthetic_run):
    run = synthetic_run()
    summary = evaluate(run).summary
    keys = Summary.__dataclass_fields__
    terminal, report = "\n".join(headlines(summary, 30)), [meaning for _, meaning in quality_cards(summary)]
    live = mission_facts(Settings.load(None, {"mission.vehicles": 2}), name="x", simulated=False)["names"]
    assert live == {
        "expected_loss": names.EXPECTED_LOSS.capitalize(),
        "cost_per_position": names.COST_PER_LOCATION,
        "layers": {"risk": "Expected loss", "p_safe": "P(deep enough)", "depth": "Depth", "std": "Standard deviation"},
    }
    assert set(names.MAP_LAYERS) == set(scales_of(15.0, 5.0))
    for key, name in {
        "risk_after": names.MAP_RISK,
        "loss_expected": names.EXPECTED_LOSS,
        "loss_after": names.ACTUAL_LOSS,
    }.items():
        assert keys[key].metadata["help"].startswith(name), key
        assert any(line.startswith(name) or f", {name} " in line for line in terminal.split("\n")), name
        assert any(meaning.startswith(name) and names.COST_PER_LOCATION in meaning for meaning in report), name


def test_figures_name_the_same_quantities(synthetic_run):
    e = evaluate(synthetic_run(steps=8))
    words = {
        name: " ".join(text.get_text() for text in figure.findobj(Text)).lower()
        for name, _, draw in FIGURES
        if (figure := draw(e)) is not None
    }
    with_unit = f"{names.MAP_RISK} ({names.COST_PER_LOCATION})"
    for name in ("risk_maps.png", "risk_over_steps.png", "local_risk_error.png"):
        assert with_unit in words[name], name
    for quantity in (names.DEPTH, names.DEPTH_STD):
        assert f"{quantity} (m)" in words["depth_map.png"]
