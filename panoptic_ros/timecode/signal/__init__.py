"""Condition audio samples (remove DC, hum and clicks) and integrate the signal over half cells."""
