"""Ranges alone: distances from several stations to targets on the tool, without angles (sequential multilateration)."""
