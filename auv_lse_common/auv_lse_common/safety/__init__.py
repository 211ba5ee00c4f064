"""The safety watch: limits of depth, altitude, place, age and charge that hold whether the planner lives or not."""
