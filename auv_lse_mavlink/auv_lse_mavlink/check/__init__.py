"""What an autopilot's parameters have to be, and how they are read and set."""
