"""Sentences of the Micromodem-2, parsed and written."""
