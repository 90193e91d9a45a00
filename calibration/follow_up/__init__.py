"""Measurements that could follow others: instruction, duration, rows and registration of each."""
