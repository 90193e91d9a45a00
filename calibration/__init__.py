"""Measured data in; error models, diagnoses, plans and reports out."""

import kinematics  # noqa: F401  limits BLAS to one thread before NumPy is loaded
