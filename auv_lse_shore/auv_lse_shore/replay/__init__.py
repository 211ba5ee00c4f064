"""Recordings played again and computed again."""
