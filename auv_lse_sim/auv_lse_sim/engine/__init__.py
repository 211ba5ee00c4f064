"""Flies missions: in one process (fleet) or as ROS 2 processes (mission)."""
