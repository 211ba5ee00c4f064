"""After the dive: where everything that was recorded was really taken, by all fixes, ranges and crossings together."""
