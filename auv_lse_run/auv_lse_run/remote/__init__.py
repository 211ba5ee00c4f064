"""auv_lse fleet on the vehicle."""
