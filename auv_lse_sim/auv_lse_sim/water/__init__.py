"""The simulated water: sound, current, ranges."""
