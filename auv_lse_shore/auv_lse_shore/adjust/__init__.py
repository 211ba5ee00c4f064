"""auv_lse adjust: re-estimates the positions of soundings after the dive."""
