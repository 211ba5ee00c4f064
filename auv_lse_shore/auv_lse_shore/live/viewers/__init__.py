"""The page of a mission, and its server."""
