"""Commands that make calibrations from measurements."""
