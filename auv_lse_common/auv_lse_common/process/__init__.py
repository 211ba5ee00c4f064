"""Processes and ROS domains: started, watched, ended."""
