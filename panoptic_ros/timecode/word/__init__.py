"""Decode the 80 bits of a word from a stretch of signal, with the exact start and its standard deviation."""
