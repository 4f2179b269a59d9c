"""Child processes: started, watched, replaced, measured, ended."""
