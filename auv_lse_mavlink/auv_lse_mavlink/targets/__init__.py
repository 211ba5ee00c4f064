"""The targets of an autopilot: ends of legs and stops, when they are sent, and whether the vehicle follows them."""
