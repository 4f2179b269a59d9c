"""Orchestration: what joins files, sources, stages and nodes into a whole run; prints nothing by itself."""
