"""What people use on deck: missions, checks, live view, replay, reports, exports, campaigns."""
