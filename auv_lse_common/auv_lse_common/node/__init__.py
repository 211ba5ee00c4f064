"""What every node is built on: parameters, timers, lockstep, journal, health."""
