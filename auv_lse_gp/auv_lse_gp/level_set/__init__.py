"""Bayes risk of the level set."""
