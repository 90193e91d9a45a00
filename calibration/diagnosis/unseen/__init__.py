"""Errors of a calibration at unseen states that its fit does not propagate."""
