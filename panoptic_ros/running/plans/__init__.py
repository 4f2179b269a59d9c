"""What a run consists of, from whatever the user gives: a folder, bags, devices, running drivers."""
