"""auv_lse fleet on the laptop."""
