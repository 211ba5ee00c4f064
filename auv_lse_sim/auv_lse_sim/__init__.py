"""Simulator: the world, its vehicles, emulated hardware, and engines that run missions."""
