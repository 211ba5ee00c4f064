"""The live view: a running mission, or a recording, on one page in a browser."""
