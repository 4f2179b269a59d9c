"""Timestamps of views: stray ones, their correction to master time, and clocks that are set back.

Sync and the continuous stage share it.
"""
