"""Motion as a function of time, from cameras that were never synchronised (Elhayek et al. 2012)."""
