"""Emulated hardware: modems on serial ports, autopilots on UDP. Each answers as the real one does."""
