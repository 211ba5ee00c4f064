"""Starting, confining, watching and ending processes."""
