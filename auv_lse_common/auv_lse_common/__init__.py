"""Common code of all packages: strict parameters, frames, named random streams, topics, nodes, processes."""
