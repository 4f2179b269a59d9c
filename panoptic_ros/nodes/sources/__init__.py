"""Nodes that publish: cameras, files, bags, and what benches put in their place."""
