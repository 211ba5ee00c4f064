"""Ground of the simulated world: synthetic lakes, and bathymetry from files."""
