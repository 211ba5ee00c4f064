"""Runs missions: in one process (fleet), or with the vehicles' ROS 2 nodes (sim_node)."""
