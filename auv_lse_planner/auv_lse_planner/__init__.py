"""Planning for a team of AUVs: motion, naive paths, rewards, tree search, and the planner of one vehicle."""
