"""What is connected to what: one table of topics, one of nodes, and the in-process runner."""
