"""Statements of a file on the set-up, compared with its data: positions of targets, zeros of runs."""
