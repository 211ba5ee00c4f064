"""The command `auv_lse`: its help, its verbs, and how one is run."""
