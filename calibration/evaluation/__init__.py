"""Comparison of calibrations, and volumetric error."""
