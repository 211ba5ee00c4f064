"""scripts/adjust: positions of soundings re-estimated after the dive."""
