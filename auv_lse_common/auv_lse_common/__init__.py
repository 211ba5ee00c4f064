"""What every package of the stack shares: strict parameters, frames, named random streams, the lockstep gate."""
