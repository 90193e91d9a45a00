"""Instruments that find balls: the touch probe with its spheres, and the ballbar."""
