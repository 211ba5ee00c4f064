"""What the live view shows: from a running mission or a recording."""
