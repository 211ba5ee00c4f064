"""The safety watch: limits on depth, altitude, position, age and battery charge, independent of the planner."""
