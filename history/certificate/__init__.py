"""Calibration certificates: who measured what, when and with what, and what it says about limits."""
