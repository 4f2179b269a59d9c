"""The course of a run, in one process or through nodes, and what it leaves."""
