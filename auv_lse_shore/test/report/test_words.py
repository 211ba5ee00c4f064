"""The results of a mission in words."""

import copy
import dataclasses
import html
import re

import pytest

from auv_lse_common.vocabulary.health import BATTERY_LASTS, LEGS_LEFT, LEGS_PLANNED
from auv_lse_planner.methods import coverage
from auv_lse_shore.judge.evaluation import evaluate
from auv_lse_shore.report.figures import depth_map, risk_maps
from auv_lse_shore.report.found_figure import found
from auv_lse_shore.report.page import number
from auv_lse_shore.report.report import page, write_outputs
from auv_lse_shore.report.report_figures import FIGURES
from auv_lse_shore.report.words import (
    ended_early,
    findings,
    headlines,
    opening_lines,
    paper_paragraphs,
    paragraphs,
    quality_cards,
    subtitle,
)

#: What the paper's reward is called where a user sees it.
PAPER = re.compile(r"team reward|path reward|lower bound|stepwise|the paper's", re.IGNORECASE)


def judged(synthetic_run, method="straddle", until=None, **changes):
    """A mission; the synthetic run's planners promise a bound, as those of `tour` do, unless it is `straddle`."""
    run = synthetic_run(steps=30)
    run.parameters["/**"]["planner"] = {"method": method}
    run.parameters["/**"]["mission"]["until"] = until or {}
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
    return " ".join([*findings(evaluation), *paragraphs(evaluation)])


def test_the_terminal_leads_with_the_isobath_and_the_map(other):
    s = other.summary
    found, exactly, missing, risk, loss, packets = headlines(s, 30)
    assert (
        f"{s.isobath_found_m:,.0f} m of isobath ({100 * s.isobath_found:.0f} % of the true isobath in the area)"
        in found
    )
    assert f"within {s.isobath_found_within_m:.1f} m" in exactly
    assert f"(actually {s.isobath_found_error_p95_m:.1f} m)" in exactly
    assert f"{s.isobath_undiscovered_m:,.0f} m of isobath expected, at most " in missing
    assert f"{s.isobath_undiscovered_limit_m:,.0f} m with 95 % probability" in missing
    assert f"(actually {(1.0 - s.isobath_found) * s.isobath_true_m:,.0f} m)" in missing
    assert (
        f"map risk: {s.risk_before:.3f} -> 0.500 (cost per location); a lawnmower was expected to reach 0.600" in risk
    )
    assert loss == f"expected loss {s.loss_expected:.3f}, actual loss {s.loss_after:.3f} (cost per location)"
    assert packets.startswith("packets: ")


def test_counts_of_packets_have_separators_of_thousands(other):
    s = dataclasses.replace(other.summary, packets_sent=12345, packets_received=23456, packets_lost=1234, delivery=0.95)
    assert "packets: 12,345 sent, 23,456 received, 1,234 receptions lost" in headlines(s, 30)
    assert "of packets received (12,345 sent)" in dict(quality_cards(s)).values()
    evaluation = copy.copy(other)
    evaluation.summary = s
    assert "12,345 packets sent; 1,234 of 24,690 possible receptions lost" in text_of(evaluation)


def test_ground_that_cannot_be_reached_is_reported_by_itself(other):
    s = other.summary
    assert "cannot be reached" not in text_of(other)
    there = dataclasses.replace(s, unreachable_m2=s.area_m2)
    start = f"{s.area_m2 / 1e4:.1f} ha of the area cannot be reached from the starts"
    assert any(line.startswith(start) for line in headlines(there, 30))


def test_the_papers_reward_is_shown_for_its_methods_alone(synthetic_run, other, tmp_path):
    assert not PAPER.search(" ".join(headlines(other.summary, 30)) + text_of(other))
    assert paper_paragraphs(other.summary) == []
    assert "The paper's reward" not in html.unescape(shown(other, tmp_path))
    paper = judged(synthetic_run, "augmented")
    assert any(PAPER.search(line) for line in headlines(paper.summary, 30))
    assert len(paper_paragraphs(paper.summary)) == 3
    assert "The paper's reward" in html.unescape(shown(paper, tmp_path))


def shown(evaluation, folder):
    """The page before the table of all values, with empty pictures."""
    drawn = []
    for name, caption, _ in FIGURES[:2]:
        (folder / name).write_bytes(b"")
        drawn.append((name, caption))
    return page(evaluation, folder, drawn).split("<h2>All values of")[0]


def test_the_first_picture_is_the_map_and_comes_before_the_words(other, tmp_path):
    text = html.unescape(shown(other, tmp_path))
    assert FIGURES[0][0] == "map.png"
    assert 0 < text.index("The final map") < text.index("<h2>Results</h2>")


def test_the_words_give_lengths_areas_reasons_and_losses_of_the_link(other):
    s, text = other.summary, text_of(other)
    assert f"found {s.isobath_found_m:,.0f} m of the 15 m isobath" in text
    assert f"{s.deep_m2 / 1e4:.1f} ha is at least 15 m deep, and {s.shallow_m2 / 1e4:.1f} ha is shallower, with" in text
    assert "17 % below that. The method straddle guarantees no such bound." in text
    possible = s.packets_received + s.packets_lost
    assert f"{s.packets_lost} of {possible} possible receptions lost (31 %)" in text
    assert f"{s.samples_received:,} samples from each other" in text
    assert "where no vehicle measured within 20 m" in text


def test_a_promised_bound_is_reported_as_met_or_not(synthetic_run, monkeypatch):
    met = judged(synthetic_run, "tour", risk_after=1.0, mowing_risk=1.5, map_bound_kept=True)
    assert met.summary.map_bound_promised
    assert "This bound was met: the mission ended 33 % below it." in text_of(met)
    assert "lawnmower bound 1.500: met" in headlines(met.summary, 30)[3]
    missed = judged(synthetic_run, "tour", risk_after=2.0, mowing_risk=1.6, map_bound_kept=False)
    assert "the mission ended 25 % above it. The bound is an expectation over all lakes" in text_of(missed)
    assert "lawnmower bound 1.600: not met" in headlines(missed.summary, 30)[3]
    nowhere = dataclasses.replace(met.summary, risk_before=0.0)  # the level does not occur
    assert "bound" not in headlines(nowhere, 30)[3]

    run = synthetic_run(steps=6)
    run.vehicles = run.vehicles[:1]
    run.parameters["/**"]["mission"]["vehicles"] = 1
    run.parameters["/**"]["planner"] = {"method": "tour"}
    covering = evaluate(run)
    covering.summary = met.summary
    for follows in (True, False):
        monkeypatch.setattr(coverage, "MAX_LANES_APART", 0.0 if follows else 1e9)
        monkeypatch.setattr(coverage, "OPEN_SHARE", 2.0)
        text = text_of(covering)
        assert ("with lanes that just cover the area was expected to reach" in text) == follows


def test_the_report_shows_legs_left_by_battery_beside_those_planned(other, tmp_path):
    lasts = "2.50 km (standard deviation 0.10 km)"
    vehicles = list(other.run.vehicles)
    battery = {LEGS_LEFT: "9", LEGS_PLANNED: "40", BATTERY_LASTS: lasts}
    vehicles[0] = dataclasses.replace(vehicles[0], battery=battery, ended_early="the battery suffices for the way")
    run = dataclasses.replace(other.run, vehicles=vehicles)
    text = shown(dataclasses.replace(other, run=run), tmp_path)
    assert "9 / 40" in text
    assert "auv1 ended early: the battery suffices for the way." in text
    assert "auv1 ended early: the battery suffices for the way." in headlines(other.summary, 30, run)
    assert not any("ended early" in line for line in headlines(other.summary, 30, other.run))
    assert f"auv1: a full battery lasts {lasts}; vehicle.battery_km lets check and GO compare" in text
    assert "full battery" not in shown(other, tmp_path)


def test_a_survey_is_no_mission_that_failed(synthetic_run, tmp_path):
    run = synthetic_run(steps=30, with_truth=False)
    later_s = 1.7e9  # stamps of a clock, not of a simulation
    vehicle = dataclasses.replace(run.vehicles[0], decisions=[], truth=[])
    vehicle.odometry[:, 0] += later_s
    vehicle.soundings = dataclasses.replace(vehicle.soundings, stamp_s=vehicle.soundings.stamp_s + later_s)
    minutes = (vehicle.odometry[-1, 0] - vehicle.odometry[0, 0]) / 60.0
    survey = dataclasses.replace(run, vehicles=[vehicle], sent=[], received=[], end_s=run.end_s + later_s)
    evaluation = evaluate(survey)
    assert subtitle(evaluation).endswith(f"1 underwater vehicle, {minutes:.1f} min, no legs.")
    shown_text = shown(evaluation, tmp_path)
    for word in ("lawnmower", "Ended early", "0 of", "path flown"):
        assert word not in shown_text
    lines = headlines(evaluation.summary, 30, survey)
    assert not any("lawnmower" in line or line.startswith("packets") for line in lines)
    evaluation.summary = dataclasses.replace(evaluation.summary, risk_before=0.3, risk_after=0.4)
    risk = paragraphs(evaluation)[0]
    assert risk == (
        "Map risk, the mean Bayes risk per location, rose from 0.300 to 0.400: the soundings are nearer to the "
        "isobath's depth than the prior expected."
    )


def cut(run, step):
    """A mission as its recording would hold it, had it been interrupted at a step."""
    for vehicle in run.vehicles:
        end_s = vehicle.decisions[step].now_s
        vehicle.decisions = vehicle.decisions[:step]
        flown = vehicle.truth[:, 0] <= end_s
        vehicle.position_std_m = vehicle.position_std_m[flown]
        vehicle.truth, vehicle.odometry = vehicle.truth[flown], vehicle.odometry[flown]
        vehicle.soundings = vehicle.soundings[vehicle.soundings.stamp_s <= end_s]
        vehicle.received = vehicle.received[vehicle.received.stamp_s <= end_s]
        run.end_s = end_s
    return run


def test_part_of_a_team_is_not_compared_with_the_bound_of_the_whole(synthetic_run, tmp_path):
    run = synthetic_run(steps=30)
    run.parameters["/**"]["planner"] = {"method": "tour"}
    team = len(run.vehicles)
    run.vehicles = run.vehicles[:1]
    evaluation = evaluate(run, bounds=2)
    s = evaluation.summary
    assert (s.mowing_risk, s.map_bound_kept, s.map_bound_promised, s.delivery) == (None, None, False, None)
    reason = headlines(s, 30, run)[0]
    assert reason.startswith(f"{team} vehicles flew this mission, but the data of auv2")
    assert "lawnmower" not in " ".join(headlines(s, 30, run)) + text_of(evaluation)
    write_outputs(evaluation, tmp_path)
    shown = (tmp_path / "report.html").read_text()
    assert reason in shown
    assert "<th>legs left / planned</th>" not in shown, "a column without values"


def test_a_mission_cut_at_step_22_of_100_is_compared_with_that_part_of_a_lawnmower_mission(synthetic_run, tmp_path):
    whole = evaluate(synthetic_run(steps=100), bounds=2)
    evaluation = evaluate(cut(synthetic_run(steps=100), 22), bounds=2)
    s = evaluation.summary
    assert (s.map_bound_kept, s.bound_kept, s.path_bound_kept, s.map_bound_promised) == (None, None, None, False)
    # Less is expected of a part than of the whole, and of a lawnmower no more than the prior allows.
    assert whole.summary.mowing_risk < 0.8 * s.mowing_risk < s.risk_before
    assert s.lawnmower_value < whole.summary.lawnmower_value
    # The synthetic vehicles mow lanes of their own: what the prior expected of them is near to what they reached.
    assert s.flown_risk == pytest.approx(s.risk_after, rel=0.4)
    assert whole.summary.flown_risk < 0.8 * s.flown_risk < s.risk_before
    assert headlines(s, 100)[0].startswith("The mission ended early, after 22 of 100 steps.")
    survey = dataclasses.replace(s, steps=0)
    assert headlines(survey, 1)[0] == (
        "No complete leg is recorded: this is a survey, or the mission ended before or on its first leg."
    )
    text = text_of(evaluation)
    assert f"The path flown was expected to reach {number(s.flown_risk, 3)}." in text
    assert (
        f"The first 22 of 100 steps of a lawnmower mission were expected to reach {number(s.mowing_risk, 3)};" in text
    )
    assert "not met" not in " ".join([*headlines(s, 100), text])
    evaluation.summary = done = dataclasses.replace(s, quality_reached=True, quality_asked="90 % found")
    assert headlines(done, 100)[0] == (
        "The mission ended because the quality asked for was reached, at step 22 of 100: 90 % found. Each vehicle "
        "returned at least 78 steps of its budget."
    )
    share = s.isobath_found_m / (s.isobath_found_m + s.isobath_undiscovered_m)
    promised = f"promised a quality instead: 90 % found. The final map of all soundings has {100 * share:.0f} % found"
    assert promised in text_of(evaluation)
    assert "Ended with the quality asked for: 22 of 100 steps." in html.unescape(shown(evaluation, tmp_path))
    evaluation.summary = s
    shown_page = html.unescape(shown(evaluation, tmp_path))
    assert "Ended early: 22 of 100 steps." in shown_page
    assert "22 of 100 steps, goal chart, method augmented" in shown_page
    assert headlines(s, 100)[0] in shown_page


def test_a_prior_that_excludes_the_isobath_is_blamed_for_the_missed_bound(synthetic_run):
    run = synthetic_run(steps=12)
    run.parameters["/**"]["planner"] = {"method": "tour"}
    run.parameters["/**"]["gp"] = {**run.parameters["/**"]["gp"], "mean_depth_m": 4.2, "signal_std_m": 4.4}
    evaluation = evaluate(run, bounds=2)
    missed = {"risk_after": 2.0, "mowing_risk": 1.6, "map_bound_kept": False}
    evaluation.summary = dataclasses.replace(evaluation.summary, **missed)
    text = text_of(evaluation)
    assert "The prior of the mission file nearly excludes this isobath: 15 m is 2.5 standard deviations" in text
    assert "Set gp.signal_std_m to 5.4 or more." in text
    assert "lake" not in text


def test_the_papers_method_promises_a_bound_of_its_reward_not_of_the_map(synthetic_run):
    paper = judged(synthetic_run, "augmented", risk_after=2.0, mowing_risk=1.6, map_bound_kept=False)
    assert not paper.summary.map_bound_promised
    assert "not met" not in " ".join(headlines(paper.summary, 30))
    assert "The method augmented guarantees no such bound." in text_of(paper)


def test_a_mission_that_is_planned_for_a_share_found_promises_no_bound(synthetic_run):
    figures = {"risk_after": 2.0, "mowing_risk": 1.6, "map_bound_kept": False}
    share = judged(synthetic_run, "tour", {"found": 0.5}, **figures)
    assert not share.summary.map_bound_promised
    assert "A mission that is planned for a share found guarantees no such bound." in text_of(share)
    assert judged(synthetic_run, "tour", {"deviation_m": 0.1}, **figures).summary.map_bound_promised


@pytest.mark.parametrize(
    ("loss", "words"),
    [
        (0.1, "the map is conservative"),
        (0.7, "the map is slightly conservative"),
        (1.0, "the two agree"),
        (1.4, "the map is slightly overconfident"),
        (4.0, "the map is overconfident"),
    ],
)
def test_the_expected_loss_is_compared_with_the_actual_one(synthetic_run, loss, words):
    assert words in text_of(judged(synthetic_run, loss_expected=1.0, loss_after=loss))


@pytest.mark.parametrize("actual", [1e-6, 0.0])
def test_losses_that_are_both_negligible_agree(synthetic_run, actual):
    assert "the two agree" in text_of(judged(synthetic_run, loss_expected=4e-6, loss_after=actual))


@pytest.mark.parametrize(
    ("known", "words"),
    [
        ({"isobath_found": 0.84, "isobath_true_m": 1000.0}, "but 160 m of the true isobath was not found."),
        ({"isobath_found": None, "isobath_undiscovered_m": 70.0}, "but 70 m of isobath is expected to be missing."),
        ({"isobath_found": 1.0, "isobath_true_m": 1000.0}, "No part of the line remains uncertain."),
    ],
)
def test_a_line_without_uncertain_parts_is_not_called_complete_while_isobath_is_missing(synthetic_run, known, words):
    lengths = {"isobath_not_visited_m": 0.0, "isobath_positions_uncertain_m": 0.0, "isobath_flat_m": 0.0}
    assert words in text_of(judged(synthetic_run, **lengths, **known))


def test_void_plans_and_time_outside_the_area_are_reported(synthetic_run):
    text = text_of(judged(synthetic_run, void_plans=(0, 2), outside_s=(0.0, 76.0), outside_max_m=(0.0, 7.5)))
    assert "2 plans were discarded" in text
    assert "outside the area for up to 76 s, by up to 7.5 m (true tracks)" in text
    kept = text_of(judged(synthetic_run, void_plans=(0, 0), outside_s=(0.0, 0.0), outside_max_m=(0.0, 0.0)))
    assert "discarded" not in kept
    assert "outside the area" not in kept


def test_a_map_without_any_isobath_is_reported(other):
    bare = dataclasses.replace(other.summary, isobath_length_m=0.0)
    kept, other.summary = other.summary, bare
    try:
        assert "shows no 15 m isobath." in text_of(other)
        assert "uncertain." in text_of(other), "the areas are still there"
        assert "not found" not in text_of(other)
    finally:
        other.summary = kept


#: Numbers and texts that no sentence shows: an amount of nothing, a wrong plural, a value that is missing.
NEVER = re.compile(
    r"(?<![\d.,])(?<!north )(?<!east )(?:0|0\.0) (?:m|ha|s|packets|samples|plans|steps)\b"
    r"|(?<![\d.,])1 \w+s\b|None|nan|inf\b"
)

#: Changes of a summary that leave nothing, or one, of what a sentence counts.
NOTHING: dict[str, dict[str, object]] = {
    "nothing likely": {"isobath_likely_m": 0.0, "isobath_guessed_m": 0.4},
    "likely only": {"isobath_guessed_m": 0.0},
    "guessed only": {"isobath_likely_m": 0.0},
    "nothing found": {
        "isobath_found_m": 0.0,
        "isobath_found": 0.0,
        "isobath_found_within_m": None,
        "isobath_found_error_m": None,
        "isobath_found_error_p95_m": None,
    },
    "no isobath": {
        "isobath_length_m": 0.0,
        "isobath_found_m": 0.0,
        "isobath_likely_m": 0.0,
        "isobath_guessed_m": 0.0,
        "isobath_found": None,
        "isobath_true_m": 0.0,
        "isobath_found_within_m": None,
        "isobath_undiscovered_m": 0.0,
        "isobath_undiscovered_limit_m": 0.0,
    },
    "all uncertain": {"deep_m2": 0.0, "shallow_m2": 0.0},
    "all shallow": {"deep_m2": 0.0, "unsure_m2": 0.0},
    "one packet": {"packets_sent": 1, "packets_received": 1, "packets_lost": 0, "samples_received": 1},
    "packets without samples": {"packets_sent": 3, "packets_received": 0, "packets_lost": 6, "samples_received": 0},
    "packets under way": {"packets_sent": 1, "packets_received": 0, "packets_lost": 0, "samples_received": 0},
    "one plan discarded": {"void_plans": (0, 1)},
    "one step returned": {"steps": 29, "quality_reached": True, "quality_asked": "90 % found"},
    "interrupted": {"steps": 12},
}


@pytest.mark.parametrize("changes", NOTHING.values(), ids=NOTHING)
def test_no_sentence_has_an_amount_of_nothing_or_a_wrong_plural(other, changes):
    kept = other.summary
    other.summary = dataclasses.replace(kept, **changes)
    try:
        text = " ".join([text_of(other), *ended_early(other.summary, 30)])
    finally:
        other.summary = kept
    assert not NEVER.search(text), NEVER.search(text)[0] + ": " + text


@pytest.mark.parametrize("vehicles", [1, 3])
def test_the_number_of_vehicles_is_that_of_the_words(other, vehicles):
    kept = other.summary
    outside = {"outside_s": (9.0,) * vehicles, "outside_max_m": (2.0,) * vehicles}
    early = {"steps": 12, "quality_reached": True, "quality_asked": "90 % found"}
    other.summary = dataclasses.replace(kept, vehicles=vehicles, **outside, **early)
    try:
        text = " ".join([text_of(other), *ended_early(other.summary, 30), subtitle(other)])
    finally:
        other.summary = kept
    assert ("he vehicle " in text) == (vehicles == 1)
    assert bool(re.search(r"\b[vV]ehicles\b", text)) == (vehicles > 1)


def test_a_prior_without_doubt_leaves_no_bound_to_compare(other):
    kept = other.summary
    other.summary = dataclasses.replace(kept, risk_before=1e-9, risk_after=9e-10, mowing_risk=1e-9, deep_m2=0.0)
    try:
        text = text_of(other)
    finally:
        other.summary = kept
    assert "Map risk was negligible from the start: the prior leaves no doubt about any location." in text
    assert "below" not in text
    assert "ha is shallower than 15 m, with" in text
    assert number(1e-9) == "0"


def test_the_opening_names_only_what_there_is():
    some = {"found": 812.0, "likely": 30.0, "guessed": 0.2}
    assert opening_lines(some, 3.2, 40.0, 110.0) == [
        "found: 812 m of isobath; 30 m likely",
        "accuracy: 95 % of the line found is expected to lie within 3.2 m of the isobath",
        "may be missing: 40 m of isobath expected, at most 110 m with 95 % probability",
    ]
    rarely_much = "may be missing: 2 m of isobath on average, but at most 1 m with 95 % probability"
    assert opening_lines(some, 3.2, 2.1, 1.0)[2] == rarely_much, "a limit below the mean is no contradiction"
    assert opening_lines(dict.fromkeys(some, 0.0), None, 0.0, 0.0) == [
        "found: 0 m of isobath",
        "accuracy: no line found",
        "may be missing: no isobath is expected elsewhere",
    ]


def test_a_lone_vehicle_without_truth_gets_no_word_of_mates_and_truth(synthetic_run):
    run = synthetic_run(steps=6, with_truth=False)
    run.vehicles = run.vehicles[:1]
    run.vehicles[0].truth = run.vehicles[0].truth[:0]
    evaluation = evaluate(run)
    text = text_of(evaluation) + " ".join(headlines(evaluation.summary, 6))
    for word in ("coustic", "true", "None", "nan"):
        assert word not in text


def test_maps_have_latitude_and_longitude_where_the_origin_is_known(synthetic_run):
    evaluation = judged(synthetic_run)
    for origin in (None, (46.5, 6.6)):
        evaluation.run.origin = origin
        counts = []
        for draw in (found, risk_maps, depth_map):
            panels = [axis for axis in draw(evaluation).axes if axis.images]
            labels = [side for axis in panels for side in axis.child_axes]
            counts.append(len(labels))
        assert counts == ([0, 0, 0] if origin is None else [2, 3, 4])  # longitudes of each panel, latitudes of the last


@pytest.mark.parametrize(
    ("area_m2", "deep_m2", "shallow_m2", "words"),
    [
        (200.0, 96.0, 69.0, "96 m2 is at least 15 m deep, and 69 m2 is shallower, with at least 95 % probability."),
        (200.0, 0.0, 0.6, "No location is classified."),
        (300_000.0, 96.0, 69.0, "No location is classified."),
        (300_000.0, 120_000.0, 700.0, "12.0 ha is at least 15 m deep, and 700 m2 is shallower, with"),
    ],
)
def test_areas_of_a_pool_are_in_square_metres(other, area_m2, deep_m2, shallow_m2, words):
    kept = other.summary
    sizes = {"area_m2": area_m2, "deep_m2": deep_m2, "shallow_m2": shallow_m2}
    other.summary = dataclasses.replace(kept, **sizes, unsure_m2=area_m2 - deep_m2 - shallow_m2)
    try:
        assert words in text_of(other)
    finally:
        other.summary = kept


def test_a_quality_that_ended_nothing_is_reported(synthetic_run):
    late = judged(synthetic_run, steps=30, quality_asked="90 % found").summary
    assert ended_early(late, 30) == [
        "All 30 steps were travelled: the quality asked for was not reached in time to end earlier (90 % found)."
    ]
    assert ended_early(judged(synthetic_run, steps=30).summary, 30) == []
