"""NC programs in; corrected programs out; the command line."""

import kinematics  # noqa: F401  limits BLAS to one thread before NumPy is loaded
