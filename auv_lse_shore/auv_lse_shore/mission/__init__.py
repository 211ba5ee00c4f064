"""The mission command: a team mission as real processes."""
