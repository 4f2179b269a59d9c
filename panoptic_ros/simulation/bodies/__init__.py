"""Simulated captures of bodies with cameras and IMUs."""
