"""Standstills in a tracker's stream: the stands of the machine, and the position of the plan of each stand.

log (time, x, y, z) -> stands -> stands and positions of the plan, in order -> rows of a measurement
"""
