"""Figures of merit of a recorded mission."""
