"""The common parts of all nodes: parameters, timers, lockstep, journal, health."""
