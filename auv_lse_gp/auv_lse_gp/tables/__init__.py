"""Tables of other programs: their dialects, columns and values."""
