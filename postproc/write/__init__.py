"""Corrected moves written back into the words of the program."""
