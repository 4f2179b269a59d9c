"""Source nodes: cameras, files and bags, and replacements for them in benchmarks."""
