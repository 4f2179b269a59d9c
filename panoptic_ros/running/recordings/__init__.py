"""Recordings of live graphs, and replay of bags onto live graphs."""
