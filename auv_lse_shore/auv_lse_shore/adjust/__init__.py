"""scripts/adjust: re-estimates the positions of soundings after the dive."""
