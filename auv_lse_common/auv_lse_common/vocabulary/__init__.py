"""What all packages speak of: places, legs, plans, missions, seeds. No ROS, no files."""
