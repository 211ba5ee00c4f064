"""The online depth map of one vehicle."""
