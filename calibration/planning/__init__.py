"""Positions to measure, and their sequence."""
