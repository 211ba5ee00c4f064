"""Recordings: written on the vehicle, read back and recovered anywhere."""
