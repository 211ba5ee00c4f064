"""MAVLink messages, parsed and written."""
