"""Writes corrected moves back into the words of the program."""
