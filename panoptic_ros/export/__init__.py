"""Write results in formats of other programs: one writer per format converts records to text or bytes."""
