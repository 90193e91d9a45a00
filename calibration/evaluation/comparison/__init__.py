"""Comparison of two calibrations of one machine in the conventions of ISO 230-1."""
