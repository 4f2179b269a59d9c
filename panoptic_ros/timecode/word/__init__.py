"""A stretch of signal to the 80 bits of a word, with its exact time and standard deviation."""
