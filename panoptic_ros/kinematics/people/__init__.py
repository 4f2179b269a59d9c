"""People: what was seen of each, whose the 2D people of an instant are, and who comes back."""
