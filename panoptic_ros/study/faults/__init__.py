"""Studies of damaged files and of accidents during live takes."""
