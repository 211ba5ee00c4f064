"""Where a vehicle can go: motion primitives, free space, naive paths."""
