"""Commands that a vehicle needs."""
