"""Samples to a signal without DC, hum and clicks; what its wave looks like, edge by edge."""
