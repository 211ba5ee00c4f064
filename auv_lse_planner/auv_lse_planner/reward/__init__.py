"""Rewards of a path: at its own locations (the paper), or over the map."""
