"""Lengths and dial readings: what a ruler, calipers, a square and a dial gauge show of a machine."""
