"""How records go from node to node: live as they come, in replay in order and until the end."""
