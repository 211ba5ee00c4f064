"""Monte Carlo tree search over action sequences."""
