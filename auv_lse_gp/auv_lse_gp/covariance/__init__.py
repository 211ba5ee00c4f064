"""Kernels, prior mean, and the marginal likelihood of their parameters."""
