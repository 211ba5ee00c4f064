"""Vehicles of real nodes without hardware: their programs, the water around them, what they must not lose."""
