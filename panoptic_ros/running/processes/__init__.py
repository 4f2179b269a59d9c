"""Child processes: start, supervision, replacement, resource use and end."""
