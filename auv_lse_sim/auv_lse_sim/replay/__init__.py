"""Recordings played again, and their decisions computed again."""
