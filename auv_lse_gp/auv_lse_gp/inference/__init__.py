"""The Gaussian process conditioned on measurements."""
