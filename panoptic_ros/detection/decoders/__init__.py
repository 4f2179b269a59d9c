"""Decoders from a network's output arrays to people: one pure function per family."""
