"""Where soundings were taken, estimated from whole recordings."""
