"""The report of a mission."""
