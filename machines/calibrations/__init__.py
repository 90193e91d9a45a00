"""Calibrations shipped with the machines, and the scripts that make them."""
