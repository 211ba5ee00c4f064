"""The names of quantities that a user meets on several screens: terminal, report, live page and charts."""

from __future__ import annotations

#: Mean Bayes risk per place, with the prior's standard deviation; planners and the lawnmower bound use it.
MAP_RISK = "map risk"

#: Mean Bayes risk per place, with the standard deviation that the soundings show.
EXPECTED_LOSS = "expected loss"

#: Mean cost of a map's wrong calls per place, where the truth is known.
ACTUAL_LOSS = "actual loss"

#: Unit of all three.
COST_PER_PLACE = "cost per place"
