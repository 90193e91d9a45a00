"""One thread for BLAS, set where the first package of ncomp is imported, and nowhere else.

The matrices of ncomp are small: threads of BLAS wait for each other, and on busy cores a command takes up to thirty
times as long. ncomp divides its work itself: `calibration/cores.py`, `kinematics/running/workers.py`.
"""

from __future__ import annotations

import os
import sys

LIMITS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""Environment variables that the libraries read when they are loaded; a value that the user has set is kept."""


def one_thread() -> None:
    """Limit BLAS to one thread in this process, and in the processes that it starts.

    SciPy loads a library of its own after NumPy's, which the environment limits; libraries that are already loaded are
    limited as they are.
    """
    if any(name in os.environ for name in LIMITS):
        return
    os.environ.update(dict.fromkeys(LIMITS, "1"))
    if "numpy" in sys.modules:
        from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

        threadpool_limits(1, user_api="blas")
