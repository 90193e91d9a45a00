"""Readers of kinematic parameters; they share no code with the writers.

A reader gives the machine with the lines that the control has.
"""
