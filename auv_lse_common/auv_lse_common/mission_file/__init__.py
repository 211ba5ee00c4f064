"""The mission file: its sections, how it is read and checked."""
