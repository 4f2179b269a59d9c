"""2D tracks on people, in the process that has their images."""
