"""Following a running mission."""
