"""Many missions, and the claims that they support."""
