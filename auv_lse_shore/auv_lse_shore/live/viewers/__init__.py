"""Viewers of a mission: the page, Foxglove, RViz."""
