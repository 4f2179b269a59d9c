"""2D tracks on people, computed in the process that has the images."""
