"""Positions to measure and their order."""
