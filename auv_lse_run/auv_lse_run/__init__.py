"""The command `auv_lse`: finds the verbs of all installed packages, and runs one."""
