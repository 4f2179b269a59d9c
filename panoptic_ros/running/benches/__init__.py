"""Benches that run whole graphs or captures."""
