"""Evaluations of one axis at a time: ISO 230-2, three points, straightness."""
