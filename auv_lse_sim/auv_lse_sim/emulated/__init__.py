"""Hardware that answers as the real one does: modems on serial ports, autopilots on UDP."""
