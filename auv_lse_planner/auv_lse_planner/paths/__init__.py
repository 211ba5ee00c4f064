"""Paths that a vehicle can travel: motion primitives, free space, naive paths."""
