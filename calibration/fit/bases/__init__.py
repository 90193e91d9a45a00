"""Bases of the error motions: the search for them, and their evidence."""
