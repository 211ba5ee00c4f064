"""Studies of the planner: methods, bound, real lakes."""
