"""Correction and check of whole programs."""
