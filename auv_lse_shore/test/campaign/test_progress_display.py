"""Times for readers."""

import pytest

from auv_lse_shore.campaign.progress_display import duration


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(float("nan"), "unknown time"), (45.2, "45 s"), (720.0, "12 min"), (12000.0, "3 h 20 min")],
)
def test_durations_for_readers(seconds, text):
    assert duration(seconds) == text
