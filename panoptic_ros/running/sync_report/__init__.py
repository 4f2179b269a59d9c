"""The clocks of a capture: what they do, what is wrong with them, and what to do."""
