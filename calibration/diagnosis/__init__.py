"""Diagnosis of a model: missing causes are found in the residuals, named, added and validated against the data."""
