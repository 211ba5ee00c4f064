"""One vehicle's nodes and its dives."""
