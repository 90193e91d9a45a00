"""Memory of a process that computes chunk after chunk."""

from __future__ import annotations

KEPT_FREED_BYTES = 32 << 20
"""Bytes of freed memory that the process keeps."""
FROM_HEAP = 32 << 20
"""Size of a column in bytes up to which it comes from there; the C library allows no more."""
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
"""Numbers of the parameters in `malloc.h` of the GNU C library."""


def keep_freed_memory() -> None:
    """Keep freed memory for the columns of the next chunk, which the system would have to clear for them again.

    Without effect where the C library is not that of GNU.
    """
    import ctypes

    try:
        library = ctypes.CDLL(None)
        library.mallopt(M_MMAP_THRESHOLD, FROM_HEAP)
        library.mallopt(M_TRIM_THRESHOLD, KEPT_FREED_BYTES)
    except (AttributeError, OSError, TypeError):
        pass
