"""What sound tells of the clocks of a run."""
