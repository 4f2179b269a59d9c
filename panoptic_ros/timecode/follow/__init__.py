"""Follow a signal from word to word: predict where the next one begins, detect breaks of the timecode."""
