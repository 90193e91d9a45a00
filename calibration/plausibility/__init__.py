"""Plausibility of a measurement, checked before any model by `fit`, `three-points` and `diagnose`."""
