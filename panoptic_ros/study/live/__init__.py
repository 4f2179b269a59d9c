"""Studies of live runs: latency, losses, failures, recording and viewers."""
