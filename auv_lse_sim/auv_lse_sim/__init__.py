"""Simulator, recorder, fleet engine, campaigns and reports."""
