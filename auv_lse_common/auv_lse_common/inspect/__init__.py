"""Looks into running nodes without the `ros2` command: topics, nodes and parameters (scripts/topics, nodes, params)."""
