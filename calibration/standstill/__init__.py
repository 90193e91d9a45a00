"""Standstills in a tracker's stream: where the machine stood, and which position of the plan each stand is.

log (time, x, y, z) -> stands -> stands and positions of the plan, in order -> rows of a measurement
"""
