"""Inspects running nodes without the `ros2` command (scripts/topics, nodes, params, run)."""
