"""Rules for an autopilot's parameters; reads and sets them."""
