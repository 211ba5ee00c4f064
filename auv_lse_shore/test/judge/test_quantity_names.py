"""One name for a quantity, whatever screen it is on."""

from auv_lse_common.mission_file.settings import Settings
from auv_lse_shore.judge import quantity_names as names
from auv_lse_shore.judge.evaluation import evaluate
from auv_lse_shore.judge.summary import Summary
from auv_lse_shore.live.sources.facts import mission_facts
from auv_lse_shore.report.words import headlines, quality_cards


def test_summary_terminal_report_and_live_page_call_a_quantity_the_same(synthetic_run):
    run = synthetic_run()
    summary = evaluate(run).summary
    keys = Summary.__dataclass_fields__
    terminal, report = "\n".join(headlines(summary, 30)), [meaning for _, meaning in quality_cards(summary)]
    live = mission_facts(Settings.load(None, {"mission.vehicles": 2}), name="x", simulated=False)["names"]
    assert live == {"expected_loss": names.EXPECTED_LOSS.capitalize(), "cost_per_place": names.COST_PER_PLACE}
    for key, name in {
        "risk_after": names.MAP_RISK,
        "loss_expected": names.EXPECTED_LOSS,
        "loss_after": names.ACTUAL_LOSS,
    }.items():
        assert keys[key].metadata["help"].startswith(name), key
        assert any(line.startswith(name) or f", {name} " in line for line in terminal.split("\n")), name
        assert any(meaning.startswith(name) and names.COST_PER_PLACE in meaning for meaning in report), name
