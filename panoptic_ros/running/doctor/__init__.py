"""Checks of this machine for `panoptic doctor`, each with a remedy for what fails."""
