"""Recordings of live graphs, and bags that are played back to them."""
