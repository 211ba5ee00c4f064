"""The measured calibration that a certificate's promises rest on: the row `all` of the table in docs/evidence/gp.md."""

from typing import Any

#: Page and section with the whole table.
PAGE = "docs/evidence/gp.md#what-may-be-missing"
#: The command that flies most of the missions and prints the table.
COMMAND = "python -m benchmarks.planning.undiscovered --first 6500 11000 --lakes 10 --real FILE"
#: Number of missions on lakes that were not used for tuning; length and loss measured on them, expected / true.
MISSIONS = 260
LENGTH_RATIO, LOSS_RATIO = 1.07, 1.03
#: Share of the line found that is within its band, `BAND_SIGMAS` standard deviations to either side.
BAND_HOLDS = 0.945
#: Share of missions in which the limit held, with its 95 % interval.
LIMIT_HOLDS, LIMIT_INTERVAL = 0.97, (0.94, 0.98)


def calibration() -> dict[str, Any]:
    """The figures for the certificate."""
    return {
        "page": PAGE,
        "command": COMMAND,
        "missions": MISSIONS,
        "line_found_within_band": BAND_HOLDS,
        "undiscovered_limit_holds": LIMIT_HOLDS,
        "undiscovered_limit_holds_interval": list(LIMIT_INTERVAL),
        "undiscovered_expected_over_true": LENGTH_RATIO,
        "loss_expected_over_true": LOSS_RATIO,
        "conditions": "simulated missions of 1 to 3 vehicles with method tour and the default prior on three kinds of "
        "made-up ground and windows of a real lake",
    }
