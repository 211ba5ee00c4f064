"""auv_lse import: turns logs of a survey that was made without this software into a run folder."""
