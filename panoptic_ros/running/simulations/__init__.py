"""Simulated captures in files."""
