"""Stay with a signal from word to word: where the next begins, and where the timecode breaks."""
