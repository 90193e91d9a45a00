"""Measured data in; error models, diagnoses, plans and reports out."""
