"""Looks over a mission file before anybody flies it."""
