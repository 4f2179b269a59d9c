"""Damaged and hostile files: mutations of a sample of every format, and how the readers take them."""
