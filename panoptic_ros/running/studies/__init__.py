"""Scores of results against the truth, and the papers' studies."""
