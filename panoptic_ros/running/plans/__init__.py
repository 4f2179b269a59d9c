"""Plans of runs, from any source that the user gives: a folder, bags, devices, running drivers."""
