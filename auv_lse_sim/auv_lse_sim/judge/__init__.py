"""How good a mission was: figures of merit, curves, pictures, the report."""
