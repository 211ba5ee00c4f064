"""Verdicts on the paper's claims."""

import numpy as np
import pytest

from auv_lse_shore.campaign.statistics import interval
from auv_lse_shore.reproduce.claims import CONTRADICTED, SUPPORTED, UNDECIDED, claims, not_worse, share, verdict


@pytest.mark.parametrize(
    ("differences", "more", "expected"),
    [
        ([1.0, 1.1, 0.9, 1.0, 1.0], True, SUPPORTED),
        ([1.0, 1.1, 0.9, 1.0, 1.0], False, CONTRADICTED),
        ([-1.0, -1.1, -0.9, -1.0, -1.0], False, SUPPORTED),
        ([1.0, -1.1, 0.2, 0.3, -0.4], True, UNDECIDED),
        ([5.0, 5.1, 4.9, 5.0], True, UNDECIDED),  # too few seeds
        ([], True, UNDECIDED),
    ],
)
def test_a_difference_decides_only_if_its_interval_does(differences, more, expected):
    assert verdict(interval(differences), more) == expected


@pytest.mark.parametrize(
    ("differences", "expected"),
    [
        ([0.4, -0.3, 0.1, -0.2, 0.0], SUPPORTED),  # within 5 % of 100
        ([40.0, -30.0, 10.0, -20.0, 0.0], UNDECIDED),  # could be much worse
        ([-1.0, -1.1, -0.9, -1.0, -1.0], CONTRADICTED),  # little, but surely worse
    ],
)
def test_at_least_as_good_needs_to_exclude_much_worse(differences, expected):
    assert not_worse(interval(differences), 100.0, True) == expected


def test_what_must_always_hold_is_contradicted_by_one_in_ten():
    assert share([True] * 10, "x").verdict == SUPPORTED
    assert share([True] * 19 + [False], "x").verdict == UNDECIDED
    assert share([True] * 9 + [False], "x").verdict == CONTRADICTED
    assert share([None, None], "x") is None
    assert share([True, False], "x").verdict == UNDECIDED
    assert share([True, None], "x").value == "1 of 1 missions"


def rows_of(reward, risk, *, error=0.1, kept=True):
    """Twenty missions whose lakes differ much more than methods do."""
    rows = []
    for seed in range(1, 21):
        lake = 50.0 * np.sin(seed)
        rows.append(
            {
                "seed": seed,
                "team_reward": reward + lake + 0.1 * (seed % 3),
                "path_reward": 1400.0 + lake,
                "risk_after": risk + 0.01 * (seed % 3),
                "risk_before": 5.0,
                "risk_third": 2.0 * risk,
                "f1": 0.9,
                "isobath_error_m": 10.0 * risk,
                "bound_kept": kept,
                "path_bound_kept": True,
                "local_risk_error": [error, error + 0.01 * (seed % 2)],
                "delivery": 0.9,
            }
        )
    return rows


def test_the_claims_follow_the_measurements():
    groups = {
        (3, "augmented"): rows_of(200.0, 1.0, kept=False),
        (3, "plain"): rows_of(230.0, 0.8),
        (3, "lawnmower"): rows_of(150.0, 0.9),
        (3, "tour"): rows_of(180.0, 0.4),
    }
    found = claims(groups)
    assert len(found) == 5
    by_text = {e.what: e.verdict for claim in found[:1] for e in claim.evidence}
    assert by_text["3 AUVs: difference in team reward, stepwise (cost)"] == CONTRADICTED
    assert by_text["3 AUVs: difference in path reward (cost)"] == SUPPORTED  # equal is as good
    assert by_text["3 AUVs: difference in final map risk (cost per location)"] == CONTRADICTED
    bound = {e.what: e for e in found[1].evidence}
    assert bound["3 AUVs: stepwise reward at least the largest time-varying lower bound"].verdict == CONTRADICTED
    assert bound["3 AUVs: path reward at least the value expected of the lawnmower"].value == "20 of 20 missions"
    flown = bound["3 AUVs: stepwise reward less that of a lawnmower over the same lakes (cost)"]
    assert flown.verdict == SUPPORTED
    local = found[2].evidence[0]
    assert local.verdict == SUPPORTED  # 0.1 is 2 % of 5
    assert "90 % of packets" in local.what
    assert "2.0 % of the risk before, 10 % of the risk after" in local.value
    assert {e.verdict for e in found[4].evidence if "final map risk" in e.what} == {SUPPORTED}


def test_each_claim_says_how_it_stands_with_either_prior():
    flat = {(3, "augmented"): rows_of(200.0, 1.0), (3, "lawnmower"): rows_of(150.0, 0.9)}
    charted = {(3, "augmented"): rows_of(200.0, 0.5), (3, "lawnmower"): rows_of(150.0, 0.9)}
    searched = next(c for c in claims(flat, charted) if "more efficiently" in c.text)
    verdicts = {(e.prior, e.verdict) for e in searched.evidence if "final map risk" in e.what}
    assert verdicts == {("flat", CONTRADICTED), ("chart", SUPPORTED)}
    # reward and F1 are alike; risk at a third, final risk and isobath turn
    assert searched.verdicts() == (
        "flat prior: 1 supported, 2 undecided, 3 contradicted; chart as prior: 4 supported, 2 undecided."
    )
    only = claims({}, charted)
    assert {e.prior for c in only for e in c.evidence} == {"chart"}
    assert "flat" not in only[0].verdicts()


def test_a_large_local_error_contradicts():
    found = claims({(2, "augmented"): rows_of(1.0, 1.0, error=0.5)})
    assert [e.verdict for claim in found if "local map" in claim.text for e in claim.evidence] == [CONTRADICTED]


def test_claims_without_missions_are_left_out():
    assert claims({}) == []
