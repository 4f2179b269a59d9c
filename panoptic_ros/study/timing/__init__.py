"""Studies of clocks, timecode and clock offsets."""
