"""Self-reports of nodes: diagnostics, log notices, counters, clock models and image previews."""
