"""Checks of a mission file."""
