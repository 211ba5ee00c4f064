"""Measurements: speed as ratios against named alternatives, and statistics too slow for the tests."""
