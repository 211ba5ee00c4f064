"""What the real world does: ground, currents, vehicles, their instruments, and sound in the water."""
