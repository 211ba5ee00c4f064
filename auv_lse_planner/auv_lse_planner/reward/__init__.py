"""Rewards of a path: at its own places (the paper), or over the map."""
