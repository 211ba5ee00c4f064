"""Tables of other programs: their dialects, the meaning of their columns, and the notations of their values."""
