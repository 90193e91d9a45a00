"""Subprograms: their names, the blocks that they begin with, and their files."""
