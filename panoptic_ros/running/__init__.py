"""Orchestration: joins files, sources, stages and nodes into a run. This package prints nothing."""
