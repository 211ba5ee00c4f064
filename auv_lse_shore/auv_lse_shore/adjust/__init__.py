"""After the dive: soundings put where they were taken."""
