"""Standstills of the machine in a tracker's stream, and the position in the plan of each.

log (time, x, y, z) -> standstills -> standstills and positions of the plan, in order -> rows of a measurement
"""
