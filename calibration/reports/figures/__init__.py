"""Figures of the reports on measured data."""
