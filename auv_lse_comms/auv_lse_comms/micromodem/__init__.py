"""A driver for the WHOI Micromodem-2: sentences, state machine, port, line log."""
