"""Ground of the simulated lake."""
