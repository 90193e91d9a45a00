"""Reading, correction, writing and verification of NC programs; the command line."""

import kinematics  # noqa: F401  limits BLAS to one thread before NumPy is loaded
