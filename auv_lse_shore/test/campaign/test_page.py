"""The page of a campaign."""

import pytest

from auv_lse_shore.campaign.page import _best

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
