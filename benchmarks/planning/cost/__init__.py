"""Processor time and memory of whole missions."""
