"""Scenes of standing people, see `standing_people`."""

from standing_people import scenes

__all__ = ["scenes"]
