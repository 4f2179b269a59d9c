"""Curves of the degrees of freedom of designated people, whose bones keep their lengths."""
