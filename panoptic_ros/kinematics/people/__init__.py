"""People: recent observations of each, assignment of 2D poses, and re-identification after an absence."""
