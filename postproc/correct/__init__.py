"""Correction, check and verification of whole programs."""
