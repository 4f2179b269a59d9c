"""Timestamps of views: their correction to master time, and rates. Sync and the continuous stage share it."""
