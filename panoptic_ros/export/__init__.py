"""Results in formats that others read: one writer per format, text or bytes from records."""
