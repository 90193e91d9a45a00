"""What a structure that was found means: verdicts, sizes, the calibration, and whether it may be used."""
