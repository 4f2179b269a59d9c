"""Structure of the graph: the table of topics, the table of stages, and the in-process runner."""
