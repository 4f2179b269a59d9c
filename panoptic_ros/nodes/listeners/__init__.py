"""Nodes that say in other words, show or keep what the graph publishes."""
