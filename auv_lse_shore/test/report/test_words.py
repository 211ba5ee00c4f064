"""What a mission achieved, in words."""

import dataclasses
import html
import re

import pytest

from auv_lse_shore.judge.evaluation import evaluate
from auv_lse_shore.report.report import page
from auv_lse_shore.report.report_figures import FIGURES
from auv_lse_shore.report.words import headlines, paper_paragraphs, paragraphs

#: What the paper's own reward is called where a user sees it.
PAPERS = re.compile(r"team reward|path reward|lower bound|stepwise|the paper's", re.IGNORECASE)


def judged(synthetic_run, method="straddle", **changes):
    """A mission; the synthetic run's planners promise a bound, as those of `tour` do, unless it is `straddle`."""
    run = synthetic_run(steps=30)
    run.parameters["/**"]["planner"] = {"method": method}
    if method == "straddle":
        for vehicle in run.vehicles:
            vehicle.decisions = [dataclasses.replace(d, lower_bound=d.reward_so_far) for d in vehicle.decisions]
    evaluation = evaluate(run)
    evaluation.summary = dataclasses.replace(evaluation.summary, **changes)
    return evaluation


@pytest.fixture(scope="module")
def other(synthetic_run):
    return judged(synthetic_run, risk_after=0.5, mowing_risk=0.6, map_bound_kept=True)


def text_of(evaluation):
    return " ".join(paragraphs(evaluation))


def test_the_terminal_leads_with_the_isobath_and_the_map(other):
    s = other.summary
    isobath, risk, calls, packets = headlines(s)
    assert (
        f"{s.isobath_found_error_m:.1f} m off on average; {100 * s.isobath_found:.0f} % of the true isobath" in isobath
    )
    assert f"{s.risk_before:.3f} -> {s.risk_after:.3f}" in risk
    assert f"mowing the lawn: {s.mowing_risk:.3f}" in risk
    assert calls == (
        f"wrong calls: the map expects {s.loss_expected:.3f} of cost per place; it really is {s.loss_after:.3f}"
    )
    assert packets.startswith("packets: ")


def test_the_papers_reward_is_shown_for_its_methods_alone(synthetic_run, other, tmp_path):
    assert not PAPERS.search(" ".join(headlines(other.summary)) + text_of(other))
    assert paper_paragraphs(other.summary) == []
    assert "The paper's own reward" not in html.unescape(shown(other, tmp_path))
    paper = judged(synthetic_run, "augmented")
    assert any(PAPERS.search(line) for line in headlines(paper.summary))
    assert len(paper_paragraphs(paper.summary)) == 3
    assert "The paper's own reward" in html.unescape(shown(paper, tmp_path))


def shown(evaluation, folder):
    """The page before the list of all figures, with pictures of nothing."""
    drawn = []
    for name, caption, _ in FIGURES[:2]:
        (folder / name).write_bytes(b"")
        drawn.append((name, caption))
    return page(evaluation, folder, drawn).split("<h2>Every figure of")[0]


def test_the_first_picture_is_the_map_and_comes_before_the_words(other, tmp_path):
    text = shown(other, tmp_path)
    assert FIGURES[0][0] == "map.png"
    assert text.index("The map that the team brought home") < text.index("<h2>What was found</h2>")


def test_the_words_tell_lengths_areas_reasons_bound_and_link(other):
    s, text = other.summary, text_of(other)
    assert f"{s.isobath_found_m:,.0f} m of the 15 m isobath were found" in text
    assert f"{s.deep_m2 / 1e4:.1f} ha are at least 15 m deep" in text
    assert "of mowing" not in text
    assert "below that. The method straddle promises nothing of it." in text
    possible = s.packets_sent
    assert f"Of these {possible} receptions, {possible - s.packets_received} were lost (31 %)" in text
    assert f"{s.samples_received:,} samples of mates" in text
    assert "nobody measured within 20 m" in text


def test_of_a_method_that_promises_the_bound_it_is_said_whether_it_held(synthetic_run):
    kept = judged(synthetic_run, "tour", risk_after=1.0, mowing_risk=1.5, map_bound_kept=True)
    assert kept.summary.map_bound_promised
    assert "it held, with 33 % less" in text_of(kept)
    assert "; the bound held)" in headlines(kept.summary)[1]
    above = judged(synthetic_run, "tour", risk_after=2.0, mowing_risk=1.6, map_bound_kept=False)
    assert "ended 25 % above it. The bound is an expectation" in text_of(above)
    assert "did not hold on this lake" in headlines(above.summary)[1]


def test_the_papers_method_promises_a_bound_of_its_own_reward_not_of_the_map(synthetic_run):
    paper = judged(synthetic_run, "augmented", risk_after=2.0, mowing_risk=1.6, map_bound_kept=False)
    assert not paper.summary.map_bound_promised
    assert "did not hold" not in " ".join(headlines(paper.summary))
    assert "The method augmented promises nothing of it." in text_of(paper)


@pytest.mark.parametrize(
    ("loss", "words"), [(0.1, "better than it believes"), (1.0, "about as much"), (4.0, "trusts itself too much")]
)
def test_the_expected_loss_is_compared_with_the_true_one(synthetic_run, loss, words):
    assert words in text_of(judged(synthetic_run, loss_expected=1.0, loss_after=loss))


def test_a_map_without_any_isobath_says_so(other):
    bare = dataclasses.replace(
        other.summary,
        isobath_length_m=0.0,
        isobath_found_m=0.0,
        isobath_not_visited_m=0.0,
        isobath_places_uncertain_m=0.0,
        isobath_flat_m=0.0,
    )
    kept, other.summary = other.summary, bare
    try:
        assert "shows no 15 m isobath at all" in text_of(other)
    finally:
        other.summary = kept


def test_a_lone_vehicle_without_truth_is_told_of_no_mates_and_no_truth(synthetic_run):
    run = synthetic_run(steps=6, with_truth=False)
    run.vehicles = run.vehicles[:1]
    run.vehicles[0].truth = run.vehicles[0].truth[:0]
    evaluation = evaluate(run)
    text = text_of(evaluation) + " ".join(headlines(evaluation.summary))
    assert "acoustic" not in text
    assert "true" not in text
    assert "None" not in text
    assert "nan" not in text
