"""Paths for calibration on the fly, and predictions of their results."""
