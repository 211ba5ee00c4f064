"""Shared vocabulary: positions, legs, plans, missions, seeds. No ROS, no files."""
