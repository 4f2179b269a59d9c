"""Simulated captures, written to files."""
