"""IMUs: their streams and units, how they sit on a body, and how their headings and clocks are found."""
