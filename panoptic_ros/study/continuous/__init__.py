"""The study of motion from cameras that were never synchronised."""
