"""Samples to a signal without DC, hum and clicks, and its integrals over half cells."""
