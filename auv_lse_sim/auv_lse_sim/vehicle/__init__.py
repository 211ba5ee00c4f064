"""The simulated vehicle and its instruments."""
