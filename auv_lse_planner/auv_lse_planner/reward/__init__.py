"""What a path is worth: at its own places (the paper), or over the map."""
