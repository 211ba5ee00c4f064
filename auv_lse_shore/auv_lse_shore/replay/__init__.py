"""Plays recordings, recomputes their maps and decisions, and renews their reports."""
