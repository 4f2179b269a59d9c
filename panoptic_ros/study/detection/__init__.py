"""Study of the detection stage."""
