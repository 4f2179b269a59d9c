"""The one adapter round stages: what comes in, what goes out, what is kept, what a node reads itself."""
