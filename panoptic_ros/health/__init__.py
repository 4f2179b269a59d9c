"""Compare cameras with their own past during tracking, and name those that were turned or zoomed."""
