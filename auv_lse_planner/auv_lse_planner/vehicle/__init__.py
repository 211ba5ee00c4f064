"""The planner of one vehicle: timing, team mates, record keeping."""
