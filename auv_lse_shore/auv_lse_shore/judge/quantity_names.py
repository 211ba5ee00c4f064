"""The names of quantities that a user meets on several screens: terminal, report, live page, maps and charts."""

#: Mean Bayes risk per location, with the prior's standard deviation; planners and the lawnmower bound use it.
MAP_RISK = "map risk"

#: Mean Bayes risk per location, with the standard deviation that the soundings show.
EXPECTED_LOSS = "expected loss"

#: Mean cost of a map's wrong calls per location, where the truth is known.
ACTUAL_LOSS = "actual loss"

#: Unit of these three.
COST_PER_LOCATION = "cost per location"

#: Probability that a location is at least as deep as the isobath.
P_DEEP = "P(deep enough)"

#: Estimated depth of the water, and its uncertainty.
DEPTH, DEPTH_STD = "depth", "standard deviation"

#: Name of each layer of a vehicle's map. A published map's risk uses the standard deviation that the soundings show.
MAP_LAYERS = {"risk": EXPECTED_LOSS, "p_safe": P_DEEP, "depth": DEPTH, "std": DEPTH_STD}
