"""Adapter that runs stages as a node.

It covers inputs, outputs, kept states, and cameras that the node reads itself.
"""
