"""Studies of navigation: position correction, surfacings, faulty sensors, the channel, the prior."""
