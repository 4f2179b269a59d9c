"""Report about the clocks of a capture: their behaviour, faults and remedies."""
