"""Statistics of the reduction of readings on the fly, as numbers and as text."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Reduction:
    """Numbers of readings used and left out, for the report."""

    readings: int
    corners: int
    """Number of readings left out close to corners or in rapid."""
    unsteady: int
    """Number of readings left out because of changing speed."""
    astray: int
    """Number of readings left out because they lie far from the median of their cell."""
    rows: int
    cell_mm: float
    corner_mm: float
    passes: int
    feeds: tuple[float, ...]
    """Feed of each pass, mm/min."""
    length_m: float
    """Length of the path, m."""
    correlation: float
    """Largest ratio, over all passes, of the variance of means to that of independent readings."""

    @property
    def used(self) -> int:
        """Number of readings that count."""
        return self.readings - self.corners - self.unsteady - self.astray

    def __str__(self) -> str:
        feeds = ", ".join(f"{feed:.0f}" for feed in sorted(set(np.round(self.feeds, -1).tolist())))
        shares = [
            f"{100 * count / self.readings:.1f} % {reason}"
            for count, reason in (
                (self.corners, f"within {self.corner_mm:g} mm of corners or in rapid"),
                (self.unsteady, "speeding up or slowing down"),
                (self.astray, "astray"),
            )
        ]
        slow = f"; the noise is correlated in time: the means are {self.correlation**0.5:.2g} times as uncertain"
        return (
            f"{self.readings} readings in {self.passes} pass{'es' * (self.passes > 1)} along {self.length_m:.2f} m at "
            f"{feeds} mm/min: {self.used} used, in {self.rows} cells of {self.cell_mm:g} mm; left out "
            f"{', '.join(shares)}{slow if self.correlation > 1.0 else ''}"
        )
