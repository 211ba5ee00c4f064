"""Studies of missions that end with a quality (`mission.until`): the distance to it, and when to end."""
