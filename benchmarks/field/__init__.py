"""A field day on one machine: real sshd processes, and a relay between laptop and vehicles that drops and delays."""
