"""Nodes that convert, display or record the output of the graph."""
